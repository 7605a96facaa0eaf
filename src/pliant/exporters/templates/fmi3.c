/* FMI 3.0 for Co-Simulation. The types and names are those of the standard (fmi-standard.org). */
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum { fmi3Independent, fmi3Constant, fmi3Fixed, fmi3Tunable, fmi3Discrete, fmi3Dependent } fmi3DependencyKind;
typedef enum { fmi3NotYetKnown, fmi3Unchanged, fmi3Changed } fmi3IntervalQualifier;
typedef void (*fmi3Log)(void *, fmi3Status, const char *, const char *);
typedef void (*fmi3Lock)(void);
typedef void (*fmi3Intermediate)(void *, double, bool, bool, bool, bool, bool *, double *);
typedef void (*fmi3ClockUpdate)(void *);

static fmi3Status tell(Instance *i, const char *text)
{
    if (i && i->log) ((fmi3Log)i->log)(i->environment, fmi3Error, "error", text);
    return fmi3Error;
}

FMI const char *fmi3GetVersion(void) { return "3.0"; }
FMI fmi3Status fmi3SetDebugLogging(void *c, bool on, size_t n, const char *const *what)
{
    (void)c, (void)on, (void)n, (void)what;
    return fmi3OK;
}
FMI void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *where, bool visible, bool logging,
                                      bool events, bool early, const uint32_t *required, size_t count,
                                      void *environment, fmi3Log log, fmi3Intermediate between)
{
    (void)where, (void)visible, (void)logging, (void)early, (void)required, (void)between;
    if (events || count || strcmp(token, "@GUID@") != 0) return NULL;
    Instance *i = calloc(1, sizeof *i);
    if (!i) return NULL;
    i->log = (void *)log;
    i->environment = environment;
    snprintf(i->name, sizeof i->name, "%s", name);
    set_up(i, 0.0);
    return i;
}
FMI void *fmi3InstantiateModelExchange(const char *name, const char *token, const char *where, bool visible, bool logging,
                                       void *environment, fmi3Log log)
{
    (void)name, (void)token, (void)where, (void)visible, (void)logging, (void)environment, (void)log;
    return NULL;
}
FMI void *fmi3InstantiateScheduledExecution(const char *name, const char *token, const char *where, bool visible,
                                            bool logging, void *environment, fmi3Log log, fmi3ClockUpdate update,
                                            fmi3Lock lock, fmi3Lock unlock)
{
    (void)name, (void)token, (void)where, (void)visible, (void)logging, (void)environment, (void)log, (void)update;
    (void)lock, (void)unlock;
    return NULL;
}
FMI void fmi3FreeInstance(void *c) { free(c); }
FMI fmi3Status fmi3EnterInitializationMode(void *c, bool tolerant, double tolerance, double start, bool stops,
                                           double stop)
{
    (void)tolerant, (void)tolerance, (void)stops, (void)stop;
    ((Instance *)c)->now.time = start;
    return fmi3OK;
}
FMI fmi3Status fmi3ExitInitializationMode(void *c) { (void)c; return fmi3OK; }
FMI fmi3Status fmi3Terminate(void *c) { (void)c; return fmi3OK; }
FMI fmi3Status fmi3Reset(void *c) { set_up(c, 0.0); return fmi3OK; }
FMI fmi3Status fmi3GetFloat64(void *c, const uint32_t *r, size_t n, double *v, size_t m)
{
    return n != m || get_reals(c, r, n, v) < 0 ? tell(c, UNKNOWN) : fmi3OK;
}
FMI fmi3Status fmi3SetFloat64(void *c, const uint32_t *r, size_t n, const double *v, size_t m)
{
    return n != m || set_reals(c, r, n, v) < 0 ? tell(c, UNKNOWN) : fmi3OK;
}
#define NONE(name, type) \
    FMI fmi3Status fmi3Get##name(void *c, const uint32_t *r, size_t n, type *v, size_t m) \
    { \
        (void)r, (void)v, (void)m; \
        return n ? tell(c, UNKNOWN) : fmi3OK; \
    } \
    FMI fmi3Status fmi3Set##name(void *c, const uint32_t *r, size_t n, const type *v, size_t m) \
    { \
        (void)r, (void)v, (void)m; \
        return n ? tell(c, UNKNOWN) : fmi3OK; \
    }
typedef const char *Text;
typedef const uint8_t *Bytes;
NONE(Float32, float)
NONE(Int8, int8_t)
NONE(UInt8, uint8_t)
NONE(Int16, int16_t)
NONE(UInt16, uint16_t)
NONE(Int32, int32_t)
NONE(UInt32, uint32_t)
NONE(Int64, int64_t)
NONE(UInt64, uint64_t)
NONE(Boolean, bool)
NONE(String, Text)
FMI fmi3Status fmi3GetBinary(void *c, const uint32_t *r, size_t n, size_t *sizes, Bytes *v, size_t m)
{
    (void)r, (void)sizes, (void)v, (void)m;
    return n ? tell(c, UNKNOWN) : fmi3OK;
}
FMI fmi3Status fmi3SetBinary(void *c, const uint32_t *r, size_t n, const size_t *sizes, const Bytes *v, size_t m)
{
    (void)r, (void)sizes, (void)v, (void)m;
    return n ? tell(c, UNKNOWN) : fmi3OK;
}
FMI fmi3Status fmi3GetClock(void *c, const uint32_t *r, size_t n, bool *v)
{
    (void)r, (void)v;
    return n ? tell(c, UNKNOWN) : fmi3OK;
}
FMI fmi3Status fmi3SetClock(void *c, const uint32_t *r, size_t n, const bool *v)
{
    (void)r, (void)v;
    return n ? tell(c, UNKNOWN) : fmi3OK;
}
FMI fmi3Status fmi3GetFMUState(void *c, void **s)
{
    if (!*s) *s = malloc(sizeof(Moment));
    if (!*s) return fmi3Error;
    memcpy(*s, &((Instance *)c)->now, sizeof(Moment));
    return fmi3OK;
}
FMI fmi3Status fmi3SetFMUState(void *c, void *s)
{
    memcpy(&((Instance *)c)->now, s, sizeof(Moment));
    return fmi3OK;
}
FMI fmi3Status fmi3FreeFMUState(void *c, void **s)
{
    (void)c;
    free(*s);
    *s = NULL;
    return fmi3OK;
}
FMI fmi3Status fmi3SerializedFMUStateSize(void *c, void *s, size_t *n)
{
    (void)c, (void)s;
    *n = sizeof(Moment);
    return fmi3OK;
}
FMI fmi3Status fmi3SerializeFMUState(void *c, void *s, uint8_t *bytes, size_t n)
{
    if (n < sizeof(Moment)) return tell(c, "too few bytes for a state");
    memcpy(bytes, s, sizeof(Moment));
    return fmi3OK;
}
FMI fmi3Status fmi3DeserializeFMUState(void *c, const uint8_t *bytes, size_t n, void **s)
{
    if (n != sizeof(Moment)) return tell(c, "these bytes are no state of this FMU");
    if (!*s) *s = malloc(sizeof(Moment));
    if (!*s) return fmi3Error;
    memcpy(*s, bytes, n);
    return fmi3OK;
}
FMI fmi3Status fmi3DoStep(void *c, double at, double h, bool keep, bool *event, bool *terminate, bool *early, double *last)
{
    (void)at, (void)keep;
    int failed = advance(c, h);
    *event = *terminate = *early = false;
    *last = ((Instance *)c)->now.time;
    return failed ? tell(c, failed == -1 ? WRONG_STEP : FAILED) : fmi3OK;
}
#define REFUSE(name, ...) \
    FMI fmi3Status name(void *c, __VA_ARGS__) { return tell(c, #name " is not provided"); }
#define REFUSE_PLAIN(name) \
    FMI fmi3Status name(void *c) { return tell(c, #name " is not provided"); }
REFUSE_PLAIN(fmi3EnterEventMode)
REFUSE_PLAIN(fmi3EnterConfigurationMode)
REFUSE_PLAIN(fmi3ExitConfigurationMode)
REFUSE_PLAIN(fmi3EvaluateDiscreteStates)
REFUSE_PLAIN(fmi3EnterContinuousTimeMode)
REFUSE_PLAIN(fmi3EnterStepMode)
REFUSE(fmi3GetNumberOfVariableDependencies, uint32_t r, size_t *n)
REFUSE(fmi3GetVariableDependencies, uint32_t r, size_t *a, uint32_t *b, size_t *d, fmi3DependencyKind *k, size_t n)
REFUSE(fmi3GetDirectionalDerivative, const uint32_t *u, size_t nu, const uint32_t *k, size_t nk, const double *s,
       size_t ns, double *v, size_t nv)
REFUSE(fmi3GetAdjointDerivative, const uint32_t *u, size_t nu, const uint32_t *k, size_t nk, const double *s, size_t ns,
       double *v, size_t nv)
REFUSE(fmi3GetIntervalDecimal, const uint32_t *r, size_t n, double *v, fmi3IntervalQualifier *q)
REFUSE(fmi3GetIntervalFraction, const uint32_t *r, size_t n, uint64_t *a, uint64_t *b, fmi3IntervalQualifier *q)
REFUSE(fmi3GetShiftDecimal, const uint32_t *r, size_t n, double *v)
REFUSE(fmi3GetShiftFraction, const uint32_t *r, size_t n, uint64_t *a, uint64_t *b)
REFUSE(fmi3SetIntervalDecimal, const uint32_t *r, size_t n, const double *v)
REFUSE(fmi3SetIntervalFraction, const uint32_t *r, size_t n, const uint64_t *a, const uint64_t *b)
REFUSE(fmi3SetShiftDecimal, const uint32_t *r, size_t n, const double *v)
REFUSE(fmi3SetShiftFraction, const uint32_t *r, size_t n, const uint64_t *a, const uint64_t *b)
REFUSE(fmi3UpdateDiscreteStates, bool *a, bool *b, bool *d, bool *e, bool *f, double *t)
REFUSE(fmi3CompletedIntegratorStep, bool keep, bool *event, bool *terminate)
REFUSE(fmi3SetTime, double t)
REFUSE(fmi3SetContinuousStates, const double *x, size_t n)
REFUSE(fmi3GetContinuousStateDerivatives, double *x, size_t n)
REFUSE(fmi3GetEventIndicators, double *x, size_t n)
REFUSE(fmi3GetContinuousStates, double *x, size_t n)
REFUSE(fmi3GetNominalsOfContinuousStates, double *x, size_t n)
REFUSE(fmi3GetNumberOfEventIndicators, size_t *n)
REFUSE(fmi3GetNumberOfContinuousStates, size_t *n)
REFUSE(fmi3GetOutputDerivatives, const uint32_t *r, size_t n, const int32_t *order, double *v, size_t m)
REFUSE(fmi3ActivateModelPartition, uint32_t clock, double time)
