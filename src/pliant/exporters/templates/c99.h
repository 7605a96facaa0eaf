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

/* Set the parameters to those of the model. Call @P@_update after a change of masses, lengths or stiffness. */
void @P@_defaults(@P@_parameters *p);
void @P@_update(@P@_parameters *p);

/* Set the state to the equilibrium under @PRESSURE@, for the parameters of @P@_defaults. */
void @P@_init(@P@_state *s);

/* Advance the state by @UP@_STEP under commanded @COMMANDS@ that are held constant. Returns 0 if the step succeeded.
 * Returns -2 if a command is not finite: the state is unchanged, call again with a finite command. Returns -1 if a
 * link turned by more than 1 rad in the step or a spring became unstable: the state is invalid, call @P@_init. */
int @P@_step(@P@_state *s, const @P@_parameters *p, const @KIND@ command[@C@]);

/* Compute the tips of the links, @AXES@ [m], and the angles of the joints relative to the rest shape [rad]. */
void @P@_tips(const @P@_state *s, const @P@_parameters *p, @KIND@ tip[@N@][@PLACES@]);
void @P@_joint_angles(const @P@_state *s, const @P@_parameters *p, @KIND@ q[@SIZE@]);

/* Compute the observed points @POINTS@: @AXES@ [m], then an angle [rad]. */
void @P@_stations(const @P@_state *s, const @P@_parameters *p, @KIND@ pose[@STATIONS@][@POSE@]);

/* Compute kinetic, elastic and gravitational energy [J]. */
void @P@_energy(const @P@_state *s, const @P@_parameters *p, @KIND@ joule[3]);
@LINEARISE@
#ifdef __cplusplus
}
#endif

#endif
