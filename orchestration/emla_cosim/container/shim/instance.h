/* One instance of the system: its memory, and its messages to the host. */

enum { INSTANTIATED = 1, INITIALIZATION = 2, STEP = 4, TERMINATED = 8, FAILED = 16, DEAD = 32 };

/* All that evolves outside of the parts. */
typedef struct {
    char guid[GUID_SIZE];
    int phase;
    int ended;     /* a part asked to end the simulation */
    int64_t steps; /* communication steps so far */
    double start_time, stop_time;
    double tolerance; /* of the solvers; 0 for those of the parts */
    Clock clock;
    double saved[ROOM(N_SAVED)]; /* what steps change, and arrays that are set, because they are set as a whole */
    double chosen[ROOM(N_VARIABLES)]; /* start values of numbers */
    unsigned char is_chosen[ROOM(N_VARIABLES)];
} Memory;

#define AT(pool, place) ((void *)&m->pool[place])

struct Instance;

/* What a message of a part needs. */
typedef struct Sender {
    const struct Sender *self;
    struct Instance *owner;
    int part;
} Sender;

typedef struct Instance {
    Memory memory;
    Stepper stepper;
    FmuInstance instances[N_PARTS + 1]; /* the last one passes Strings on */
    Group groups[ROOM(N_GROUPS)];
    Call calls[ROOM(N_CALLS)];
    ClockedCall clocked_calls[ROOM(N_CLOCKED_CALLS)];
    Events events[ROOM(N_EVENTS)];
    StepEnd ends[ROOM(N_PARTS)];
    SavedState states[ROOM(N_PARTS)]; /* those at the start of the present step, of groups */
    double *stores[N_STORES];
    double room[ROOM(N_ROOM)];       /* for what no step keeps */
    double numbers[ROOM(MOST_SIZE)]; /* the values of a variable in the type of its part: no type is larger */
    fmi2Component parts[ROOM(N_PARTS)];
    Function functions[ROOM(N_LIBRARIES)][N_FUNCTIONS];
    void *handles[ROOM(N_LIBRARIES)];
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

static int is_version_3(int part) { return libraries[parts[part].library].fmi == 3; }

/* Report what a part answered. After an error the instance can only be reset or set to a
   state, after fmi2Fatal not even that. */
static Status blame_part(Instance *instance, int part, const char *what, int32_t status) {
    static const char *const names[] = {"OK", "Warning", "Discard", "Error", "Fatal", "Pending"};
    const int is_known = status >= fmi2OK && status <= fmi2Pending, fatal = status == fmi2Fatal;
    instance->memory.phase = fatal ? DEAD : FAILED;
    return report(instance, fatal ? StatusFatal : StatusError, "%s answered %s with fmi%d%s.", parts[part].name,
                  what, libraries[parts[part].library].fmi, is_known ? names[status] : "Status that does not exist");
}

#if N_TEXT_LINKS > 0
static fmi2Status step_texts(fmi2Component c, fmi2Real time, fmi2Real length, fmi2Boolean no_way_back);
#endif
