/* Code shared by FMI 2 and 3: an instance of @P@ with numbered variables. The wrapper of each version includes it.
 * Variables: 0 time; then @INPUTS@ inputs; then @OUTPUTS@ outputs; then @PARAMETERS@ parameters. */
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* When the sources are linked into a program, the functions have the FMU's name as a prefix, so that several FMUs can
 * be linked. In a shared library they have the standard's names: compile it with @FMI@_OVERRIDE_FUNCTION_PREFIX. */
#define @FMI@_FUNCTION_PREFIX @NAME@_
#if !defined FMI2_OVERRIDE_FUNCTION_PREFIX && !defined FMI3_OVERRIDE_FUNCTION_PREFIX && !defined DISABLE_PREFIX
#define @FMI@_ACTUAL_FUNCTION_PREFIX @FMI@_FUNCTION_PREFIX
#endif
#ifdef @FMI@_ACTUAL_FUNCTION_PREFIX
#define PASTED(prefix, name) prefix##name
#define JOINED(prefix, name) PASTED(prefix, name)
#define FULL_NAME(name) JOINED(@FMI@_ACTUAL_FUNCTION_PREFIX, name)
@FUNCTIONS@
#endif

#if defined _WIN32
#define FMI __declspec(dllexport)
#else
#define FMI __attribute__((visibility("default")))
#endif

enum { INPUTS = @INPUTS@, OUTPUTS = @OUTPUTS@, PARAMETERS = @PARAMETERS@ };

typedef struct {
    @P@_state state;
    @P@_parameters parameters;
    double command[INPUTS];
    double time;
    int changed; /* whether parameters changed since the last update */
} Moment; /* the content of a saved state of the FMU */

typedef struct {
    Moment now;
    void *environment;
    void *log;
    char name[128];
} Instance;

static void set_up(Instance *i, double time)
{
    @P@_defaults(&i->now.parameters);
    @P@_init(&i->now.state);
    memset(i->now.command, 0, sizeof i->now.command);
@START@
    i->now.time = time;
    i->now.changed = 0;
}

static void refresh(Instance *i)
{
    if (i->now.changed) @P@_update(&i->now.parameters);
    i->now.changed = 0;
}

static void outputs(Instance *i, double *y)
{
    double pose[@STATIONS@][@POSE@], joule[3];
    refresh(i);
    @P@_stations(&i->now.state, &i->now.parameters, pose);
    for (int k = 0; k < @STATIONS@; k++)
        for (int c = 0; c < @POSE@; c++) *y++ = pose[k][c];
    @P@_joint_angles(&i->now.state, &i->now.parameters, y);
    y += @COORDINATES@;
    for (int c = 0; c < INPUTS; c++) *y++ = i->now.state.pressure[c];
    @P@_energy(&i->now.state, &i->now.parameters, joule);
    for (int k = 0; k < 3; k++) *y++ = joule[k];
}

/* Address of parameter k; the struct of parameters contains only numbers of one type. */
static double *parameter(Instance *i, uint32_t k) { return (double *)&i->now.parameters + k; }

static int get_reals(Instance *i, const uint32_t *refs, size_t count, double *values)
{
    double y[OUTPUTS];
    int found = 0;
    for (size_t k = 0; k < count; k++) {
        uint32_t r = refs[k];
        if (r == 0) values[k] = i->now.time;
        else if (r <= INPUTS) values[k] = i->now.command[r - 1];
        else if (r <= INPUTS + OUTPUTS) {
            if (!found) outputs(i, y);
            found = 1;
            values[k] = y[r - 1 - INPUTS];
        } else if (r <= INPUTS + OUTPUTS + PARAMETERS) values[k] = *parameter(i, r - 1 - INPUTS - OUTPUTS);
        else return -1;
    }
    return 0;
}

static int set_reals(Instance *i, const uint32_t *refs, size_t count, const double *values)
{
    for (size_t k = 0; k < count; k++) {
        uint32_t r = refs[k];
        if (r >= 1 && r <= INPUTS) i->now.command[r - 1] = values[k];
        else if (r > INPUTS + OUTPUTS && r <= INPUTS + OUTPUTS + PARAMETERS) {
            *parameter(i, r - 1 - INPUTS - OUTPUTS) = values[k];
            i->now.changed = 1;
        } else return -1;
    }
    return 0;
}

/* Returns 0 on success, -1 if h is no whole number of steps, -2 if a step failed. */
static int advance(Instance *i, double h)
{
    double steps = h / @STEP@;
    long count = (long)(steps + 0.5);
    if (count < 1 || steps - (double)count > 1e-6 || (double)count - steps > 1e-6) return -1;
    refresh(i);
    for (long k = 0; k < count; k++)
        if (@P@_step(&i->now.state, &i->now.parameters, i->now.command) < 0) return -2;
    i->now.time += (double)count * @STEP@;
    return 0;
}

static const char *const WRONG_STEP = "the communication step must be a whole number of steps of @STEP@ s";
static const char *const FAILED = "a step failed: a link turned by more than a radian, a spring gave way, or a pressure "
                                  "is not finite; lower the pressure, or export with a shorter step";
static const char *const UNKNOWN = "a variable has no such value reference, or cannot be set";
