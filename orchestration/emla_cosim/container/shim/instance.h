/* One instance of the system: its memory, and its messages to the host. */

#define TIME_TOLERANCE 1e-6 /* of times of the host, as a fraction of the step */

enum { INSTANTIATED = 1, INITIALIZATION = 2, STEP = 4, TERMINATED = 8, FAILED = 16, DEAD = 32 };

/* Communication point k is (first + k * per_step) / denominator, so that only the division rounds. */
typedef struct {
    double first, per_step, denominator;
} Clock;

/* What a repeated step restores. */
typedef struct {
    double signals[ROOM(N_SIGNALS)];
    double previous[ROOM(N_SIGNALS)]; /* signals one communication point earlier */
    double largest[ROOM(N_SIGNALS)];  /* absolute values so far */
    double at[ROOM(N_PARTS)];         /* time of the signals of each part */
    double before[ROOM(N_PARTS)];     /* time of the previous ones */
    double taken[ROOM(N_INPUTS)];     /* signal that an input with a rare reader read last */
    double taken_at[ROOM(N_INPUTS)];
} Exchange;

/* All that evolves outside of the parts. */
typedef struct {
    char guid[GUID_SIZE];
    int phase;
    double steps; /* communication steps so far */
    double start_time, stop_time;
    Clock clock;
    Exchange now;
    double jacobians[ROOM(N_JACOBIANS)];
    double chosen[ROOM(N_VARIABLES)]; /* start values of numbers */
    unsigned char is_chosen[ROOM(N_VARIABLES)];
    double elements[ROOM(N_ELEMENTS)]; /* of arrays that are set, because they are set as a whole */
    double tolerance; /* of the solvers; 0 for those of the parts */
    int ended;        /* a part asked to end the simulation */
} Memory;

struct Instance;

/* What a message of a part needs. */
typedef struct Sender {
    const struct Sender *self;
    struct Instance *owner;
    int part;
} Sender;

typedef struct Instance {
    Memory memory;
    fmi2Component parts[ROOM(N_PARTS)];
    fmi2FMUstate begin[ROOM(N_PARTS)]; /* states at the begin of the present step, of groups */
    Exchange kept;                     /* the exchange at the begin of the present step */
    Functions functions[ROOM(N_LIBRARIES)];
    void *handles[ROOM(N_LIBRARIES)];
    double inputs[ROOM(N_INPUTS)], derivatives[ROOM(N_INPUTS)];
    double numbers[ROOM(MOST_VALUES)];   /* those of a call, */
    double converted[ROOM(MOST_VALUES)]; /* and in the type of the part: no type is larger */
    char *name;
    char *location; /* URI of the resources, or NULL */
    fmi2CallbackFunctions callbacks[ROOM(N_PARTS)];
    Sender senders[ROOM(N_PARTS)];
    Logger logger;
    Environment environment;
    unsigned logged; /* categories that are switched on, as bits */
    int settled;     /* whether initial values agree with the values that were set */
    int goes_back;   /* whether the host saved a state */
} Instance;

#include "messages.h"

/* Whether this is one of our senders. Some FMUs pass other things than their componentEnvironment: small
   numbers, or their own memory. */
static int is_sender(fmi2ComponentEnvironment environment) {
    const uintptr_t address = (uintptr_t)environment;
    const Sender *sender = environment;
    return address >= 4096 && address % sizeof(void *) == 0 && sender->self == sender;
}

/* Whether a message of a part with this environment and status is passed on. */
static int hears(void *environment, Status status) {
    return is_sender(environment) && is_logged(((const Sender *)environment)->owner, status);
}

/* Pass on a message of a part, with its name. */
static void relay(void *environment, Status status, const char *text) {
    const Sender *sender = environment;
    char message[3 * MESSAGE_LENGTH];
    const char *part = parts[sender->part].name;
    const int is_named = strncmp(text, part, strlen(part)) == 0;
    snprintf(message, sizeof message, "%s%s%s", is_named ? "" : part, is_named ? "" : ": ", text);
    deliver(sender->owner, status, message);
}

static const char *phase_name(int phase) {
    switch (phase) {
        case INSTANTIATED: return "instantiated";
        case INITIALIZATION: return "initialization";
        case STEP: return "step";
        case TERMINATED: return "terminated";
        default: return "error";
    }
}

static Status require(const Instance *instance, int phases, const char *action) {
    if (instance->memory.phase & phases) return StatusOK;
    return report(instance, StatusError, "cannot %s in phase %s.", action, phase_name(instance->memory.phase));
}

/* What a call returns whose reason is logged: StatusFatal after fmi2Fatal of a part. */
static Status failed(const Instance *instance) {
    return instance->memory.phase == DEAD ? StatusFatal : StatusError;
}

/* Whether a status is worse than a warning. */
static int is_bad(fmi2Status status) { return status > fmi2Warning || status < fmi2OK; }

/* Report what a part answered. After an error the instance can only be reset or set to a
   state, after fmi2Fatal not even that. */
static Status blame(Instance *instance, int part, const char *what, fmi2Status status) {
    static const char *const names[] = {"OK", "Warning", "Discard", "Error", "Fatal", "Pending"};
    const int is_known = status >= fmi2OK && status <= fmi2Pending, fatal = status == fmi2Fatal;
    instance->memory.phase = fatal ? DEAD : FAILED;
    return report(instance, fatal ? StatusFatal : StatusError, "%s answered %s with fmi%d%s.", parts[part].name,
                  what, libraries[parts[part].library].fmi, is_known ? names[status] : "Status that does not exist");
}
