/* FMI 2.0 for Co-Simulation. The types and names are those of the standard (fmi-standard.org). */
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef void (*fmi2CallbackLogger)(void *, const char *, fmi2Status, const char *, const char *, ...);
typedef struct {
    fmi2CallbackLogger logger;
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(void *, fmi2Status);
    void *componentEnvironment;
} fmi2CallbackFunctions;

static fmi2Status tell(Instance *i, const char *text)
{
    const fmi2CallbackFunctions *f = i->log;
    if (f && f->logger) f->logger(f->componentEnvironment, i->name, fmi2Error, "error", "%s", text);
    return fmi2Error;
}

FMI const char *fmi2GetTypesPlatform(void) { return "default"; }
FMI const char *fmi2GetVersion(void) { return "2.0"; }
FMI fmi2Status fmi2SetDebugLogging(void *c, int on, size_t n, const char *const *what)
{
    (void)c, (void)on, (void)n, (void)what;
    return fmi2OK;
}
FMI void *fmi2Instantiate(const char *name, fmi2Type type, const char *guid, const char *where,
                          const fmi2CallbackFunctions *functions, int visible, int logging)
{
    (void)where, (void)visible, (void)logging;
    if (type != fmi2CoSimulation || strcmp(guid, "@GUID@") != 0) return NULL;
    Instance *i = calloc(1, sizeof *i);
    if (!i) return NULL;
    i->log = (void *)functions;
    snprintf(i->name, sizeof i->name, "%s", name);
    set_up(i, 0.0);
    return i;
}
FMI void fmi2FreeInstance(void *c) { free(c); }
FMI fmi2Status fmi2SetupExperiment(void *c, int tolerant, double tolerance, double start, int stops, double stop)
{
    (void)tolerant, (void)tolerance, (void)stops, (void)stop;
    ((Instance *)c)->now.time = start;
    return fmi2OK;
}
FMI fmi2Status fmi2EnterInitializationMode(void *c) { (void)c; return fmi2OK; }
FMI fmi2Status fmi2ExitInitializationMode(void *c) { (void)c; return fmi2OK; }
FMI fmi2Status fmi2Terminate(void *c) { (void)c; return fmi2OK; }
FMI fmi2Status fmi2Reset(void *c) { set_up(c, 0.0); return fmi2OK; }
FMI fmi2Status fmi2GetReal(void *c, const unsigned *r, size_t n, double *v)
{
    return get_reals(c, r, n, v) < 0 ? tell(c, UNKNOWN) : fmi2OK;
}
FMI fmi2Status fmi2SetReal(void *c, const unsigned *r, size_t n, const double *v)
{
    return set_reals(c, r, n, v) < 0 ? tell(c, UNKNOWN) : fmi2OK;
}
#define NONE(name, type) \
    FMI fmi2Status name(void *c, const unsigned *r, size_t n, type v) \
    { \
        (void)r, (void)v; \
        return n ? tell(c, UNKNOWN) : fmi2OK; \
    }
NONE(fmi2GetInteger, int *)
NONE(fmi2GetBoolean, int *)
NONE(fmi2GetString, const char **)
NONE(fmi2SetInteger, const int *)
NONE(fmi2SetBoolean, const int *)
NONE(fmi2SetString, const char *const *)
FMI fmi2Status fmi2GetFMUstate(void *c, void **s)
{
    if (!*s) *s = malloc(sizeof(Moment));
    if (!*s) return fmi2Error;
    memcpy(*s, &((Instance *)c)->now, sizeof(Moment));
    return fmi2OK;
}
FMI fmi2Status fmi2SetFMUstate(void *c, void *s)
{
    memcpy(&((Instance *)c)->now, s, sizeof(Moment));
    return fmi2OK;
}
FMI fmi2Status fmi2FreeFMUstate(void *c, void **s)
{
    (void)c;
    free(*s);
    *s = NULL;
    return fmi2OK;
}
FMI fmi2Status fmi2SerializedFMUstateSize(void *c, void *s, size_t *n)
{
    (void)c, (void)s;
    *n = sizeof(Moment);
    return fmi2OK;
}
FMI fmi2Status fmi2SerializeFMUstate(void *c, void *s, char *bytes, size_t n)
{
    if (n < sizeof(Moment)) return tell(c, "too few bytes for a state");
    memcpy(bytes, s, sizeof(Moment));
    return fmi2OK;
}
FMI fmi2Status fmi2DeSerializeFMUstate(void *c, const char *bytes, size_t n, void **s)
{
    if (n != sizeof(Moment)) return tell(c, "these bytes are no state of this FMU");
    if (!*s) *s = malloc(sizeof(Moment));
    if (!*s) return fmi2Error;
    memcpy(*s, bytes, n);
    return fmi2OK;
}
FMI fmi2Status fmi2GetDirectionalDerivative(void *c, const unsigned *u, size_t nu, const unsigned *k, size_t nk,
                                            const double *dk, double *du)
{
    (void)u, (void)nu, (void)k, (void)nk, (void)dk, (void)du;
    return tell(c, "directional derivatives are not provided");
}
FMI fmi2Status fmi2SetRealInputDerivatives(void *c, const unsigned *r, size_t n, const int *order, const double *v)
{
    (void)r, (void)n, (void)order, (void)v;
    return tell(c, "pressures are held over a step: they have no derivatives");
}
FMI fmi2Status fmi2GetRealOutputDerivatives(void *c, const unsigned *r, size_t n, const int *order, double *v)
{
    (void)r, (void)n, (void)order, (void)v;
    return tell(c, "derivatives of outputs are not provided");
}
FMI fmi2Status fmi2DoStep(void *c, double at, double h, int keep)
{
    (void)at, (void)keep;
    int failed = advance(c, h);
    return failed ? tell(c, failed == -1 ? WRONG_STEP : FAILED) : fmi2OK;
}
FMI fmi2Status fmi2CancelStep(void *c) { return tell(c, "no step is pending"); }
FMI fmi2Status fmi2GetStatus(void *c, fmi2StatusKind kind, fmi2Status *v)
{
    (void)c, (void)kind, (void)v;
    return fmi2Discard;
}
FMI fmi2Status fmi2GetRealStatus(void *c, fmi2StatusKind kind, double *v)
{
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *v = ((Instance *)c)->now.time;
    return fmi2OK;
}
FMI fmi2Status fmi2GetIntegerStatus(void *c, fmi2StatusKind kind, int *v)
{
    (void)c, (void)kind, (void)v;
    return fmi2Discard;
}
FMI fmi2Status fmi2GetBooleanStatus(void *c, fmi2StatusKind kind, int *v)
{
    (void)c, (void)kind, (void)v;
    return fmi2Discard;
}
FMI fmi2Status fmi2GetStringStatus(void *c, fmi2StatusKind kind, const char **v)
{
    (void)c, (void)kind, (void)v;
    return fmi2Discard;
}
