@COMMENT@#ifndef @UP@_H
#define @UP@_H

#define @UP@_LINKS @N@
#define @UP@_CHAMBERS @C@
#define @UP@_STATIONS @STATIONS@
#define @UP@_STEP @STEP@ /* s */

#ifdef __cplusplus
extern "C" {
#endif

typedef @REAL@ @KIND@;

typedef struct {
@STATE@
} @P@_state;

typedef struct {
@PARAMETERS@
} @P@_parameters;

/* The numbers of the model; after a change of masses, lengths or stiffness call @P@_update. */
void @P@_defaults(@P@_parameters *p);
void @P@_update(@P@_parameters *p);

/* At rest under @PRESSURE@ Pa, with the numbers of @P@_defaults. */
void @P@_init(@P@_state *s);

/* One step of @UP@_STEP under commanded @COMMANDS@ held constant: 0; -2 where a command is not finite: no step
 * is taken and nothing of it enters the dead time, so call again with a pressure of your choice; -1 where a link turns
 * by more than a radian in the step or a spring gave way: the state is of no use then, call @P@_init. */
int @P@_step(@P@_state *s, const @P@_parameters *p, const @KIND@ command[@C@]);

/* Tips of the links, @AXES@ [m]; angles of the joints from the rest shape [rad]. */
void @P@_tips(const @P@_state *s, const @P@_parameters *p, @KIND@ tip[@N@][@PLACES@]);
void @P@_joint_angles(const @P@_state *s, const @P@_parameters *p, @KIND@ q[@SIZE@]);

/* The observed points @POINTS@: @AXES@ [m], then an angle [rad]. */
void @P@_stations(const @P@_state *s, const @P@_parameters *p, @KIND@ pose[@STATIONS@][@POSE@]);

/* Kinetic, elastic and gravitational energy [J]. */
void @P@_energy(const @P@_state *s, const @P@_parameters *p, @KIND@ joule[3]);
@LINEARISE@
#ifdef __cplusplus
}
#endif

#endif
