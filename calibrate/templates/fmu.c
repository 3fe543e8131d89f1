/* FMI 2.0 around the equations above, for model exchange and for co-simulation.

   All variables stand in one array: parameters' entries, settings, start, inputs, outputs, states, derivatives. */

#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif
#ifdef FMI2_FUNCTION_PREFIX /* where several units are linked into one program */
#define JOIN(a, b) a##b
#define JOINED(a, b) JOIN(a, b)
#define NAMED(name) JOINED(FMI2_FUNCTION_PREFIX, name)
#else
#define NAMED(name) name
#endif
#define FUNCTION EXPORT Status NAMED
#define UNUSED(x) (void)(x)

typedef unsigned int Reference;
typedef const char *String;
typedef int Boolean;
typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } Status;
typedef enum { MODEL_EXCHANGE, CO_SIMULATION } Type;
typedef struct {
    void (*logger)(void *environment, String instance, Status status, String category, String message, ...);
    void *(*allocateMemory)(size_t count, size_t size);
    void (*freeMemory)(void *memory);
    void (*stepFinished)(void *environment, Status status);
    void *environment;
} Callbacks;
typedef struct {
    Boolean newDiscreteStatesNeeded, terminateSimulation, nominalsChanged, statesChanged, nextEventTimeDefined;
    double nextEventTime;
} EventInfo;

enum {
    MAX_STEP = N_P,
    ATMOSPHERE,
    S,
    U = S + N_S,
    Y = U + N_U,
    X = Y + N_Y,
    DX = X + N_X,
    N_V = DX + N_X
};

typedef struct {
    double v[N_V];
    double rates[N_U]; /* of inputs, a second, until the next communication point */
    int starting;      /* the state still follows from parameters and inputs */
    int stale;         /* outputs and derivatives are those of earlier values */
} Data;

typedef struct {
    Data data;
    const Callbacks *callbacks;
    char name[128];
} Unit;

static Status fail(const Unit *unit, String message) {
    if (unit->callbacks->logger)
        unit->callbacks->logger(unit->callbacks->environment, unit->name, ERROR, "logStatusError", "%s", message);
    return ERROR;
}

static void reset(Data *d) {
    memset(d, 0, sizeof *d);
    memcpy(d->v, START, sizeof START);
    d->starting = d->stale = 1;
}

static void read_inputs(const Data *d, double duration, double *u) {
    u[0] = duration;
    u[1] = d->v[ATMOSPHERE] - STANDARD_ATMOSPHERE;
    for (int i = 0; i < N_U; ++i) {
        u[2 + 2 * i] = d->v[U + i];
        u[3 + 2 * i] = IS_HELD[i] ? 0.0 : d->rates[i];
    }
}

static void refresh(Data *d) {
    double u[2 + 2 * N_U];
    if (!d->stale) return;
    read_inputs(d, 0.0, u);
    if (d->starting) vg_start(d->v, d->v + S, u, d->v + X);
    vg_reports(d->v, u, d->v + X, d->v + Y);
    vg_derivatives(d->v, u, d->v + X, d->v + DX);
    d->stale = 0;
}

EXPORT String NAMED(fmi2GetTypesPlatform)(void) { return "default"; }
EXPORT String NAMED(fmi2GetVersion)(void) { return "2.0"; }

EXPORT void *NAMED(fmi2Instantiate)(String name, Type type, String guid, String resources, const Callbacks *callbacks,
                                    Boolean visible, Boolean logging) {
    UNUSED(type), UNUSED(resources), UNUSED(visible), UNUSED(logging);
    if (!callbacks || !callbacks->allocateMemory || !guid || strcmp(guid, GUID) != 0) return NULL;
    Unit *unit = callbacks->allocateMemory(1, sizeof(Unit));
    if (!unit) return NULL;
    unit->callbacks = callbacks;
    strncpy(unit->name, name ? name : "", sizeof unit->name - 1);
    unit->name[sizeof unit->name - 1] = 0;
    reset(&unit->data);
    return unit;
}

EXPORT void NAMED(fmi2FreeInstance)(Unit *unit) {
    if (unit) unit->callbacks->freeMemory(unit);
}

FUNCTION(fmi2SetDebugLogging)(Unit *unit, Boolean on, size_t n, const String categories[]) {
    UNUSED(unit), UNUSED(on), UNUSED(n), UNUSED(categories);
    return OK;
}

FUNCTION(fmi2SetupExperiment)(Unit *unit, Boolean hasTolerance, double tolerance, double start, Boolean hasStop,
                              double stop) {
    UNUSED(unit), UNUSED(hasTolerance), UNUSED(tolerance), UNUSED(start), UNUSED(hasStop), UNUSED(stop);
    return OK;
}

FUNCTION(fmi2EnterInitializationMode)(Unit *unit) {
    UNUSED(unit);
    return OK;
}

FUNCTION(fmi2ExitInitializationMode)(Unit *unit) {
    refresh(&unit->data);
    unit->data.starting = 0;
    return OK;
}

FUNCTION(fmi2Terminate)(Unit *unit) {
    UNUSED(unit);
    return OK;
}

FUNCTION(fmi2Reset)(Unit *unit) {
    reset(&unit->data);
    return OK;
}

/* Values of variables */

FUNCTION(fmi2GetReal)(Unit *unit, const Reference r[], size_t n, double values[]) {
    for (size_t i = 0; i < n; ++i) {
        if (r[i] >= N_V) return fail(unit, "no variable has this value reference");
        if (r[i] >= Y) refresh(&unit->data);
        values[i] = unit->data.v[r[i]];
    }
    return OK;
}

FUNCTION(fmi2SetReal)(Unit *unit, const Reference r[], size_t n, const double values[]) {
    for (size_t i = 0; i < n; ++i) {
        if (r[i] >= Y) return fail(unit, "only parameters, the start and inputs can be set");
        unit->data.v[r[i]] = values[i];
    }
    unit->data.stale = 1;
    return OK;
}

FUNCTION(fmi2GetBoolean)(Unit *unit, const Reference r[], size_t n, Boolean values[]) {
    for (size_t i = 0; i < n; ++i) {
        if (r[i] < S || r[i] >= U) return fail(unit, "no variable of this value reference is true or false");
        values[i] = unit->data.v[r[i]] != 0;
    }
    return OK;
}

FUNCTION(fmi2SetBoolean)(Unit *unit, const Reference r[], size_t n, const Boolean values[]) {
    for (size_t i = 0; i < n; ++i) {
        if (r[i] < S || r[i] >= U) return fail(unit, "no variable of this value reference is true or false");
        unit->data.v[r[i]] = values[i] != 0;
    }
    unit->data.stale = 1;
    return OK;
}

#define NO_VARIABLES(get, set, type) \
    FUNCTION(get)(Unit *unit, const Reference r[], size_t n, type values[]) { \
        UNUSED(r), UNUSED(values); \
        return n ? fail(unit, "there are no variables of this type") : OK; \
    } \
    FUNCTION(set)(Unit *unit, const Reference r[], size_t n, const type values[]) { \
        UNUSED(r), UNUSED(values); \
        return n ? fail(unit, "there are no variables of this type") : OK; \
    }
NO_VARIABLES(fmi2GetInteger, fmi2SetInteger, int)
NO_VARIABLES(fmi2GetString, fmi2SetString, String)

/* The whole state, to go back to it */

FUNCTION(fmi2GetFMUstate)(Unit *unit, void **state) {
    if (!*state) *state = unit->callbacks->allocateMemory(1, sizeof(Data));
    if (!*state) return fail(unit, "there is no memory for a state");
    memcpy(*state, &unit->data, sizeof(Data));
    return OK;
}

FUNCTION(fmi2SetFMUstate)(Unit *unit, void *state) {
    memcpy(&unit->data, state, sizeof(Data));
    return OK;
}

FUNCTION(fmi2FreeFMUstate)(Unit *unit, void **state) {
    if (*state) unit->callbacks->freeMemory(*state);
    *state = NULL;
    return OK;
}

FUNCTION(fmi2SerializedFMUstateSize)(Unit *unit, void *state, size_t *size) {
    UNUSED(unit), UNUSED(state);
    *size = sizeof(Data);
    return OK;
}

FUNCTION(fmi2SerializeFMUstate)(Unit *unit, void *state, char bytes[], size_t size) {
    if (size < sizeof(Data)) return fail(unit, "a serialized state needs more bytes");
    memcpy(bytes, state, sizeof(Data));
    return OK;
}

FUNCTION(fmi2DeSerializeFMUstate)(Unit *unit, const char bytes[], size_t size, void **state) {
    if (size < sizeof(Data)) return fail(unit, "a serialized state has more bytes");
    if (!*state) *state = unit->callbacks->allocateMemory(1, sizeof(Data));
    if (!*state) return fail(unit, "there is no memory for a state");
    memcpy(*state, bytes, sizeof(Data));
    return OK;
}

FUNCTION(fmi2GetDirectionalDerivative)(Unit *unit, const Reference unknowns[], size_t m, const Reference knowns[],
                                       size_t n, const double seed[], double values[]) {
    UNUSED(unknowns), UNUSED(m), UNUSED(knowns), UNUSED(n), UNUSED(seed), UNUSED(values);
    return fail(unit, "there are no directional derivatives");
}

/* Model exchange */

FUNCTION(fmi2EnterEventMode)(Unit *unit) {
    UNUSED(unit);
    return OK;
}

FUNCTION(fmi2NewDiscreteStates)(Unit *unit, EventInfo *info) {
    UNUSED(unit);
    memset(info, 0, sizeof *info);
    return OK;
}

FUNCTION(fmi2EnterContinuousTimeMode)(Unit *unit) {
    UNUSED(unit);
    return OK;
}

FUNCTION(fmi2CompletedIntegratorStep)(Unit *unit, Boolean noSet, Boolean *enterEventMode, Boolean *terminate) {
    UNUSED(unit), UNUSED(noSet);
    *enterEventMode = *terminate = 0;
    return OK;
}

FUNCTION(fmi2SetTime)(Unit *unit, double time) {
    UNUSED(unit), UNUSED(time);
    return OK;
}

FUNCTION(fmi2SetContinuousStates)(Unit *unit, const double x[], size_t n) {
    if (n != N_X) return fail(unit, "there are more or fewer states");
    memcpy(unit->data.v + X, x, N_X * sizeof *x);
    unit->data.stale = 1;
    return OK;
}

FUNCTION(fmi2GetContinuousStates)(Unit *unit, double x[], size_t n) {
    if (n != N_X) return fail(unit, "there are more or fewer states");
    refresh(&unit->data);
    memcpy(x, unit->data.v + X, N_X * sizeof *x);
    return OK;
}

FUNCTION(fmi2GetDerivatives)(Unit *unit, double dx[], size_t n) {
    if (n != N_X) return fail(unit, "there are more or fewer states");
    refresh(&unit->data);
    memcpy(dx, unit->data.v + DX, N_X * sizeof *dx);
    return OK;
}

FUNCTION(fmi2GetNominalsOfContinuousStates)(Unit *unit, double x[], size_t n) {
    if (n != N_X) return fail(unit, "there are more or fewer states");
    memcpy(x, NOMINAL, N_X * sizeof *x);
    return OK;
}

FUNCTION(fmi2GetEventIndicators)(Unit *unit, double z[], size_t n) {
    UNUSED(z);
    return n ? fail(unit, "there are no event indicators") : OK;
}

/* Co-simulation: the library's integrator */

FUNCTION(fmi2SetRealInputDerivatives)(Unit *unit, const Reference r[], size_t n, const int order[],
                                      const double values[]) {
    for (size_t i = 0; i < n; ++i) {
        if (r[i] < U || r[i] >= Y || order[i] != 1) return fail(unit, "only inputs have a derivative, and only a first");
        unit->data.rates[r[i] - U] = values[i];
    }
    return OK;
}

FUNCTION(fmi2GetRealOutputDerivatives)(Unit *unit, const Reference r[], size_t n, const int order[], double values[]) {
    UNUSED(r), UNUSED(n), UNUSED(order), UNUSED(values);
    return fail(unit, "there are no derivatives of outputs");
}

FUNCTION(fmi2DoStep)(Unit *unit, double time, double duration, Boolean noSet) {
    Data *d = &unit->data;
    double u[2 + 2 * N_U], next[N_X];
    UNUSED(time), UNUSED(noSet);
    if (!(duration >= 0) || !(d->v[MAX_STEP] > 0)) return fail(unit, "a step and max_step must be positive");
    const double steps = ceil(duration / d->v[MAX_STEP] * (1 - 1e-9));
    const double length = duration / (steps < 1 ? 1 : steps);
    read_inputs(d, duration, u);
    for (double i = 0; i < steps || i < 1; ++i) {
        vg_step(d->v, u, d->v + X, i * length, length, next);
        memcpy(d->v + X, next, sizeof next);
    }
    for (int i = 0; i < N_U; ++i) {
        if (!IS_HELD[i]) d->v[U + i] += d->rates[i] * duration;
        d->rates[i] = 0.0;
    }
    d->stale = 1;
    for (int i = 0; i < N_X; ++i)
        if (!isfinite(d->v[X + i])) return fail(unit, "the simulation left the finite numbers: check the parameters");
    return OK;
}

FUNCTION(fmi2CancelStep)(Unit *unit) { return fail(unit, "a step is done at once"); }

#define NO_STATUS(name, type) \
    FUNCTION(name)(Unit *unit, int kind, type *value) { \
        UNUSED(unit), UNUSED(kind), UNUSED(value); \
        return DISCARD; \
    }
NO_STATUS(fmi2GetStatus, Status)
NO_STATUS(fmi2GetRealStatus, double)
NO_STATUS(fmi2GetIntegerStatus, int)
NO_STATUS(fmi2GetBooleanStatus, Boolean)
NO_STATUS(fmi2GetStringStatus, String)
