/* FMI 2.0 around the equations above. */

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

/* All variables stand in one array: parameters' entries, settings, start, inputs, outputs, states, derivatives. */
enum {
    SETTINGS = N_P,
    S = SETTINGS + N_SETTINGS,
    U = S + N_S,
    Y = U + N_U,
    X = Y + N_Y,
    DX = X + N_X,
    N_V = DX + N_DX
};

typedef struct {
    double v[N_V];
    double rates[N_U]; /* of inputs, a second, until the next communication point */
    double due;        /* time to the next sample of a controller in s */
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

/* What differs between a plant and a controller stands at the end. */
static void refresh(Data *d);                    /* brings outputs up to date */
static String advance(Data *d, double duration); /* gives what is wrong, or NULL */

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
    unit->data.starting = STARTS_LATE;
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

/* Co-simulation */

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
    UNUSED(time), UNUSED(noSet);
    String wrong = duration >= 0 ? advance(d, duration) : "a step must not be negative";
    if (wrong) return fail(unit, wrong);
    for (int i = 0; i < N_U; ++i) {
        if (!IS_HELD[i]) d->v[U + i] += d->rates[i] * duration;
        d->rates[i] = 0.0;
    }
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
