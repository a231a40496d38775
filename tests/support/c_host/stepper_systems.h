/* Random systems for stepper_host.c: toys, connections, programs, groups and faults, all from one seed.
 *
 * Each table is allocated alone and exactly as large as the stepper's header says, so that the address sanitizer
 * sees any access outside of it.
 */
#ifndef STEPPER_SYSTEMS_H
#define STEPPER_SYSTEMS_H

enum { MOST_CALLS = 160, MOST_OPERATIONS = 128, MOST_GROUPS = 2, N_SPANS = 3, MOST_STORES = 8 };
enum { MOST_COMBINATIONS = 3, MOST_TERMS = 3 };
enum { MOST_EXTRA = 3 };    /* elements of an array that are not connected */
enum { MOST_COUPLING = 4 }; /* coupling variables of a group */

/* ---- tables ---------------------------------------------------------------------------- */

/* Memory that lives as long as the system. */
static void *own(System *system, size_t count, size_t size) {
    REQUIRE(system->n_owned < sizeof system->owned / sizeof system->owned[0], "there are too many tables");
    return system->owned[system->n_owned++] = allocate(count, size);
}

static void *own_copy(System *system, const void *content, int32_t count, size_t size) {
    void *table = own(system, (size_t)count, size);
    if (count > 0) memcpy(table, content, (size_t)count * size);
    return table;
}

static double *own_doubles(System *system, int32_t count) { return own(system, (size_t)count, sizeof(double)); }

static double *own_random(System *system, int32_t count) {
    double *numbers = own_doubles(system, count);
    for (int32_t k = 0; k < count; k++) numbers[k] = uniform(&system->dice, -1.0, 1.0);
    return numbers;
}

static double *own_equal(System *system, int32_t count, double value) {
    double *numbers = own_doubles(system, count);
    for (int32_t k = 0; k < count; k++) numbers[k] = value;
    return numbers;
}

static void shuffle(Dice *dice, int32_t *numbers, int32_t n) {
    for (int32_t k = n - 1; k > 0; k--) {
        const int32_t other = below(dice, k + 1), number = numbers[k];
        numbers[k] = numbers[other];
        numbers[other] = number;
    }
}

/* Room for the draft of a system; tables of exactly the right size are copies of its parts. */
typedef struct {
    FmuInstance instances[MOST_INSTANCES];
    int32_t every[MOST_INSTANCES]; /* steps that an instance does at once */
    int32_t group[MOST_INSTANCES]; /* -1 without one */
    Input inputs[MOST_INSTANCES * MOST_VALUES];
    Signal signals[MOST_INSTANCES * MOST_VALUES];
    Operation operations[MOST_OPERATIONS];
    Combination combinations[MOST_COMBINATIONS];
    Term terms[MOST_COMBINATIONS * MOST_TERMS];
    Group groups[MOST_GROUPS];
    int32_t is_saved[MOST_GROUPS];
    int32_t n_observed[MOST_INSTANCES]; /* variables */
    int32_t n_inputs, n_combinations, n_terms;
} Draft;

/* ---- calls that set and get values ----------------------------------------------------- */

typedef struct {
    Call calls[MOST_CALLS];
    int32_t n;
} Calls;

static void add_call(System *system, Calls *list, int32_t i, int32_t is_version_3, Occasion occasion, int32_t type,
                     int32_t n_references, int32_t n_values) {
    const Function *functions = is_version_3 ? (occasion == SETTING ? setters_3 : getters_3)
                                             : (occasion == SETTING ? setters_2 : getters_2);
    const uint32_t first = (uint32_t)(occasion * PER_OCCASION + list->n * PER_CALL);
    uint32_t *references = own(system, (size_t)n_references, sizeof *references);
    for (int32_t r = 0; r < n_references; r++) references[r] = first + (uint32_t)r;
    REQUIRE(list->n < MOST_CALLS, "there are too many calls");
    list->calls[list->n] = (Call){.function = functions[type],
                                  .component = &system->toys[i],
                                  .references = references,
                                  .code = INSTANCE_CODE * (i + 1) + CODE_OF_CALLS * (occasion + 1) + list->n,
                                  .n_references = n_references,
                                  .n_values = n_values,
                                  .type = type,
                                  .instance = i,
                                  .is_version_3 = is_version_3};
    list->n++;
}

/* Add a call whose values are numbers of a vector themselves. An array of FMI 3.0 is one reference. */
static void add_direct_call(System *system, Calls *list, int32_t i, int32_t is_version_3, Occasion occasion,
                            double *numbers, int32_t count) {
    const int32_t n_references = is_version_3 ? between(&system->dice, 1, count) : count;
    add_call(system, list, i, is_version_3, occasion, TYPE_FLOAT64, n_references, count);
    list->calls[list->n - 1].values = numbers;
}

/* Add a call that converts `items`; in FMI 3.0 they are spread over arrays. */
static void add_typed_call(System *system, Calls *list, int32_t i, int32_t is_version_3, Occasion occasion,
                           int32_t type, const int32_t *items, int32_t count) {
    Dice *dice = &system->dice;
    int32_t places[MOST_VALUES + MOST_EXTRA];
    const int32_t n_values = count + (is_version_3 ? below(dice, MOST_EXTRA + 1) : 0);
    const int32_t n_references = is_version_3 ? between(dice, 1, n_values) : n_values;
    for (int32_t k = 0; k < n_values; k++) places[k] = k;
    shuffle(dice, places, n_values);
    add_call(system, list, i, is_version_3, occasion, type, n_references, n_values);
    Call *call = &list->calls[list->n - 1];
    call->values = own(system, (size_t)n_values, size_of_type[type]);
    for (int32_t k = 0; k < n_values; k++) put_number(call->values, type, k, 1.0);
    if (type == TYPE_BOOLEAN) memset(call->values, 1, (size_t)n_values);
    call->items = own_copy(system, items, count, sizeof *items);
    call->places = own_copy(system, places, count, sizeof *places);
    call->n_items = count;
}

static int32_t draw_type(Dice *dice, int32_t is_version_3) {
    static const int32_t types_2[] = {TYPE_FLOAT64, TYPE_INT32, TYPE_BOOLEAN_2};
    return is_version_3 ? below(dice, TYPE_BOOLEAN + 1) : types_2[below(dice, 3)];
}

/* Add the calls for `count` numbers of a vector: some directly, the rest by type. */
static void add_calls(System *system, Calls *list, int32_t i, int32_t is_version_3, Occasion occasion,
                      double *vector, int32_t first, int32_t count, int32_t all_direct) {
    Dice *dice = &system->dice;
    int32_t types[MOST_VALUES], items[MOST_VALUES];
    if (count == 0) return;
    const int32_t n_direct = all_direct || happens(dice, 0.4) ? count : happens(dice, 0.3) ? below(dice, count) : 0;
    if (n_direct > 0) add_direct_call(system, list, i, is_version_3, occasion, vector + first, n_direct);
    for (int32_t k = n_direct; k < count; k++) types[k] = draw_type(dice, is_version_3);
    for (int32_t type = TYPE_FLOAT64; type <= TYPE_BOOLEAN_2; type++) {
        int32_t n = 0;
        for (int32_t k = n_direct; k < count; k++)
            if (types[k] == type) items[n++] = first + k;
        shuffle(dice, items, n);
        if (n > 0) add_typed_call(system, list, i, is_version_3, occasion, type, items, n);
    }
}

/* ---- instances ------------------------------------------------------------------------- */

static void draft_instance(System *system, Draft *draft, int32_t i) {
    Dice *dice = &system->dice;
    Stepper *s = &system->stepper;
    FmuInstance *instance = &draft->instances[i];
    memset(instance, 0, sizeof *instance);
    instance->is_version_3 = happens(dice, 0.5);
    instance->mode = instance->is_version_3 ? below(dice, LINE) : below(dice, LINE + 1);
    instance->n_outputs = below(dice, MOST_VALUES + 1);
    instance->first_output = s->n_signals;
    for (int32_t k = 0; k < instance->n_outputs; k++)
        draft->signals[s->n_signals++] = (Signal){.floor = happens(dice, 0.2) ? 1e-6 : uniform(dice, 0.01, 1.0),
                                                  .instance = i,
                                                  .is_smooth = happens(dice, 0.7)};
    draft->group[i] = s->n_groups > 0 && happens(dice, 0.6) ? below(dice, s->n_groups) : -1;
    const int is_rare = draft->group[i] < 0 && happens(dice, 0.35) && !system->is_controlled;
    draft->every[i] = is_rare ? between(dice, 2, 5) : 1;
    instance->is_rare = draft->every[i] > 1;
}

/* A few inputs read signals that are known in advance. */
static int32_t draft_known(Dice *dice, const FmuInstance *instance) {
    if (!happens(dice, 0.2)) return NOT_KNOWN;
    const int32_t known = between(dice, KNOWN_SAMPLE, KNOWN_MEAN);
    return known == KNOWN_LINE && instance->mode != LINE ? KNOWN_MEAN : known;
}

/* Connect the inputs of an instance, once all signals are known. */
static void draft_inputs(System *system, Draft *draft, int32_t i) {
    Dice *dice = &system->dice;
    FmuInstance *instance = &draft->instances[i];
    instance->first_input = draft->n_inputs;
    if (system->stepper.n_signals > 0) instance->n_inputs = below(dice, MOST_VALUES + 1);
    for (int32_t k = 0; k < instance->n_inputs; k++)
        draft->inputs[draft->n_inputs++] = (Input){.factor = uniform(dice, -1.0, 1.0),
                                                   .offset = uniform(dice, -1.0, 1.0),
                                                   .signal = below(dice, system->stepper.n_signals),
                                                   .moves = happens(dice, 0.7),
                                                   .known = draft_known(dice, instance)};
    instance->has_slopes = instance->mode == LINE;
    instance->is_held = instance->mode == HOLD;
    for (int32_t k = 0; k < instance->n_inputs; k++)
        if (draft->inputs[instance->first_input + k].known != NOT_KNOWN) instance->is_held = 0;
}

/* Let most inputs of whole numbers fit into any type; a few are at the limits of theirs. */
static void adapt_inputs(System *system, Draft *draft, const Calls *setters) {
    Dice *dice = &system->dice;
    for (int32_t c = 0; c < setters->n; c++)
        for (int32_t k = 0; k < setters->calls[c].n_items; k++) {
            Input *input = &draft->inputs[setters->calls[c].items[k]];
            const int32_t type = setters->calls[c].type;
            if (is_whole(type)) input->offset = uniform(dice, 40.0, 60.0);
            if (happens(dice, 0.01)) input->factor = happens(dice, 0.5) ? 1e3 : -1e300;
            if (!happens(dice, 0.04)) continue;
            input->factor = 0.0;
            input->offset = happens(dice, 0.5) ? smallest_of(type) : largest_of(type);
            input->offset += 0.5 * between(dice, -2, 2);
        }
}

static void finish_instance(System *system, Draft *draft, int32_t i) {
    Dice *dice = &system->dice;
    Stepper *s = &system->stepper;
    FmuInstance *instance = &draft->instances[i];
    const int32_t is_version_3 = instance->is_version_3, n_inputs = instance->n_inputs;
    const int is_saved = system->is_controlled || (draft->group[i] >= 0 && draft->is_saved[draft->group[i]]);
    Calls setters = {.n = 0}, getters = {.n = 0};
    add_calls(system, &setters, i, is_version_3, SETTING, s->input_values, instance->first_input, n_inputs,
              instance->mode == LINE);
    add_calls(system, &getters, i, is_version_3, GETTING, s->stores[SIGNALS], instance->first_output,
              instance->n_outputs, 0);
    adapt_inputs(system, draft, &setters);
    instance->setters = own_copy(system, setters.calls, setters.n, sizeof(Call));
    instance->getters = own_copy(system, getters.calls, getters.n, sizeof(Call));
    instance->n_setters = setters.n;
    instance->n_getters = getters.n;
    instance->component = &system->toys[i];
    instance->do_step = is_version_3 ? (Function)do_step_of_toy_3 : (Function)do_step_of_toy_2;
    instance->code = INSTANCE_CODE * (i + 1);
    instance->code_derivatives = DERIVING, instance->code_step = STEPPING, instance->code_status = ASKING;
    instance->code_save = SAVING, instance->code_restore = RESTORING;
    instance->state = &system->states[i];
    instance->has_no_way_back = !is_saved;
    if (is_version_3) instance->end = own(system, 1, sizeof(StepEnd));
    if (is_saved) { /* functions that must not be called are NULL otherwise */
        instance->get_state = is_version_3 ? (Function)get_state_3 : (Function)get_state_2;
        instance->set_state = is_version_3 ? (Function)set_state_3 : (Function)set_state_2;
        if (!is_version_3 && happens(dice, 0.8)) instance->get_status = (Function)get_status_of_toy;
    }
    if (instance->mode != LINE) return;
    uint32_t *references = own(system, (size_t)n_inputs, sizeof *references);
    fmi2Integer *orders = own(system, (size_t)n_inputs, sizeof *orders);
    for (int32_t k = 0; k < n_inputs; k++) references[k] = (uint32_t)k, orders[k] = 1;
    instance->set_derivatives = (Function)set_derivatives_2;
    instance->references = references;
    instance->orders = orders;
}

static void build_toys(System *system, const Draft *draft) {
    Dice *dice = &system->dice;
    const Clock *clock = &system->stepper.clock;
    const double signs[] = {-1.0, 1.0};
    for (int32_t i = 0; i < system->n_instances; i++) {
        const int64_t begun = system->first - system->first % draft->every[i]; /* the point of its next step */
        Toy *toy = &system->toys[i];
        memset(toy, 0, sizeof *toy);
        toy->system = system;
        toy->instance = i;
        toy->knowledge.id = -1;
        toy->state.time = (clock->first + (double)begun * clock->per_step) / clock->denominator;
        toy->state.x = uniform(dice, -1.0, 1.0);
        toy->decay = uniform(dice, 0.0, 2.0);
        toy->gain = uniform(dice, -2.0, 2.0);
        toy->feedthrough = happens(dice, 0.7) ? uniform(dice, -0.8, 0.8) : 0.0;
        toy->restlessness = happens(dice, 0.04) ? 1.0 : 0.0; /* a loop with it never agrees */
        toy->scale = signs[below(dice, 2)] * uniform(dice, 0.5, 3.0);
    }
}

/* ---- groups ---------------------------------------------------------------------------- */

static void finish_group(System *system, Draft *draft, int32_t g) {
    Dice *dice = &system->dice;
    Group *group = &draft->groups[g];
    int32_t members[MOST_INSTANCES], coupling[MOST_INSTANCES * MOST_VALUES];
    int32_t n_members = 0, n_signals = 0;
    for (int32_t i = 0; i < system->n_instances; i++)
        if (draft->group[i] == g) members[n_members++] = i;
    shuffle(dice, members, n_members);
    for (int32_t m = 0; m < n_members; m++)
        for (int32_t k = 0; k < draft->instances[members[m]].n_outputs; k++)
            coupling[n_signals++] = draft->instances[members[m]].first_output + k;
    shuffle(dice, coupling, n_signals);
    const int32_t most = n_signals < MOST_COUPLING ? n_signals : MOST_COUPLING, n = between(dice, 0, most);
    const int32_t history = system->stepper.sweeps * n, calls[] = {SET_INPUTS, DO_STEP, GET_OUTPUTS};
    Operation operations[3 * MOST_INSTANCES];
    for (int32_t o = 0; o < 3 * n_members; o++)
        operations[o] = (Operation){.call = calls[o % 3], .target = members[o / 3], .every = 1};
    *group = (Group){.members = own_copy(system, members, n_members, sizeof *members),
                     .coupling = own_copy(system, coupling, n, sizeof *coupling),
                     .operations = own_copy(system, operations, 3 * n_members, sizeof *operations),
                     .jacobian = own_equal(system, n * n, 0.0),
                     .guess = own_doubles(system, n),
                     .sizes = own_doubles(system, n),
                     .direction = own_doubles(system, n),
                     .earlier = own_doubles(system, n * n),
                     .basis = own_doubles(system, n * n),
                     .residuals = own_doubles(system, history),
                     .answers = own_doubles(system, history),
                     .kept = own_doubles(system, 2 * n_signals + 2 * n_members),
                     .n_members = n_members,
                     .n_coupling = n,
                     .n_operations = 3 * n_members,
                     .is_saved = draft->is_saved[g],
                     .is_halved = happens(dice, 0.7)};
    for (int32_t c = 0; c < n; c++) group->jacobian[c * n + c] = 0.9;
}

/* ---- programs -------------------------------------------------------------------------- */

/* Operations whose order is fixed; a program is a random merge of several such lists. */
typedef struct {
    Operation operations[8];
    int32_t n, n_merged;
} Track;

static void add_operation(Track *track, int32_t call, int32_t target, int32_t every, int32_t store) {
    track->operations[track->n++] = (Operation){.call = call, .target = target, .every = every, .store = store};
}

/* Set, step and get an instance; sometimes a call is missing, or done twice. */
static void fill_track(System *system, const Draft *draft, Track *track, int32_t i) {
    Dice *dice = &system->dice;
    const int32_t every = draft->every[i];
    const int32_t n_sets = happens(dice, 0.05) ? 0 : happens(dice, 0.1) ? 2 : 1;
    const int32_t n_gets = happens(dice, 0.05) ? 0 : happens(dice, 0.1) ? 2 : 1;
    for (int32_t n = 0; n < n_sets; n++) {
        const int32_t store = happens(dice, 0.7) ? SIGNALS : below(dice, system->n_stores);
        add_operation(track, SET_INPUTS, i, every, store);
    }
    if (happens(dice, 0.97)) add_operation(track, DO_STEP, i, every, 0);
    for (int32_t n = 0; n < n_gets; n++) add_operation(track, GET_OUTPUTS, i, every, 0);
}

static void draft_combination(System *system, Draft *draft) {
    Dice *dice = &system->dice;
    const int32_t n_terms = between(dice, 1, MOST_TERMS), n_own = system->n_stores - FIRST_STORE;
    const int32_t into = n_own > 0 && happens(dice, 0.7) ? FIRST_STORE + below(dice, n_own) : SIGNALS;
    draft->combinations[draft->n_combinations++] = (Combination){.instance = below(dice, system->n_instances),
                                                                 .into = into,
                                                                 .first_term = draft->n_terms,
                                                                 .n_terms = n_terms};
    for (int32_t t = 0; t < n_terms; t++) /* sums that do not grow from step to step */
        draft->terms[draft->n_terms++] =
            (Term){.factor = uniform(dice, -1.0, 1.0) / n_terms, .store = below(dice, system->n_stores)};
}

/* Merge tracks at random, or the first of each, then the second of each, and so on. */
static void merge_tracks(System *system, Draft *draft, Track *tracks, int32_t n_tracks) {
    Dice *dice = &system->dice;
    Stepper *s = &system->stepper;
    const int in_turn = happens(dice, 0.4);
    int32_t rest = 0, next = 0;
    for (int32_t t = 0; t < n_tracks; t++) rest += tracks[t].n;
    while (rest > 0) {
        const int32_t t = in_turn ? next++ % n_tracks : below(dice, n_tracks);
        Track *track = &tracks[t];
        if (track->n_merged == track->n) continue;
        draft->operations[s->n_operations++] = track->operations[track->n_merged++];
        rest--;
    }
}

static void draft_program(System *system, Draft *draft) {
    Dice *dice = &system->dice;
    Track tracks[MOST_INSTANCES + MOST_GROUPS + MOST_COMBINATIONS];
    int32_t n_tracks = 0;
    memset(tracks, 0, sizeof tracks);
    for (int32_t i = 0; i < system->n_instances; i++)
        if (draft->group[i] < 0) fill_track(system, draft, &tracks[n_tracks++], i);
    for (int32_t g = 0; g < system->stepper.n_groups; g++)
        if (draft->groups[g].n_members > 0) add_operation(&tracks[n_tracks++], SOLVE, g, 1, 0);
    for (int32_t n = happens(dice, 0.5) ? below(dice, MOST_COMBINATIONS + 1) : 0; n > 0; n--) {
        add_operation(&tracks[n_tracks++], COMBINE, draft->n_combinations, between(dice, 1, 3), 0);
        draft_combination(system, draft);
    }
    merge_tracks(system, draft, tracks, n_tracks);
}

/* ---- faults ---------------------------------------------------------------------------- */

static Effect draw_effect(Dice *dice, Occasion occasion, int32_t is_version_3) {
    static const Effect of_steps[] = {GIVE_STATUS, REFUSE_LONG, REFUSE_LONG, WANT_END,
                                      WANT_END,    RAISE_STOP,  NEED_EVENT,  END_EARLY};
    static const Effect of_values[] = {GIVE_STATUS, GIVE_NAN, GIVE_INFINITY, GIVE_HUGE, RAISE_STOP};
    if (occasion == STEPPING) return of_steps[below(dice, is_version_3 ? 8 : 6)];
    if (occasion == GETTING || occasion == OBSERVING) return of_values[below(dice, 5)];
    return occasion == ASKING || happens(dice, 0.8) ? GIVE_STATUS : RAISE_STOP;
}

/* Whether calls of this kind are made. */
static int can_occur(const Draft *draft, int32_t i, Occasion occasion) {
    const FmuInstance *instance = &draft->instances[i];
    switch (occasion) {
        case SETTING: return instance->n_inputs > 0;
        case GETTING: return instance->n_outputs > 0;
        case OBSERVING: return draft->n_observed[i] > 0;
        case DERIVING: return instance->mode == LINE && instance->n_inputs > 0;
        case STEPPING: return 1;
        case ASKING: return instance->get_status != NULL;
        default: return !instance->has_no_way_back;
    }
}

static void draw_faults(System *system, const Draft *draft) {
    static const int32_t statuses[] = {fmi2Discard, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending, -1, 99};
    Dice *dice = &system->dice;
    system->n_faults = happens(dice, 0.35) ? 0 : between(dice, 1, MOST_FAULTS);
    for (int32_t f = 0; f < system->n_faults; f++) {
        int32_t i;
        Occasion occasion;
        do {
            i = below(dice, system->n_instances);
            occasion = (Occasion)below(dice, N_OCCASIONS);
        } while (!can_occur(draft, i, occasion));
        const Effect effect = draw_effect(dice, occasion, draft->instances[i].is_version_3);
        const int64_t first = between(dice, 1, happens(dice, 0.5) || occasion == OBSERVING ? 4 : 40);
        const int64_t last = effect == REFUSE_LONG || happens(dice, 0.3) ? INT64_MAX : first;
        system->faults[f] = (Fault){.first = first,
                                    .last = last,
                                    .occasion = occasion,
                                    .effect = effect,
                                    .instance = i,
                                    .status = statuses[below(dice, 7)]};
    }
}

/* ---- systems --------------------------------------------------------------------------- */

static void draw_times(System *system) {
    static const double denominators[] = {1000.0, 64.0, 7.0, 3.0};
    Dice *dice = &system->dice;
    system->stepper.last_point = INFINITY;
    system->stepper.clock = (Clock){.first = between(dice, -3, 3),
                                    .per_step = between(dice, 1, 4),
                                    .denominator = denominators[below(dice, 4)]};
    system->step = system->stepper.clock.per_step / system->stepper.clock.denominator;
    system->first = happens(dice, 0.5) ? 0 : below(dice, 20);
    system->count = between(dice, 1, 30);
    system->every = happens(dice, 0.4) ? 1 : between(dice, 2, happens(dice, 0.8) ? 6 : 40);
    system->tick_probability = happens(dice, 0.3) ? 0.1 : 0.0;
}

/* Move all that steps change into one block, as error control needs it. */
static void gather_memory(System *system, int32_t n_inputs) {
    Stepper *s = &system->stepper;
    const int32_t n = s->n_signals, n_instances = system->n_instances;
    double *stores[MOST_STORES];
    system->n_memory = (system->n_stores + 1) * n + 2 * n_instances + 2 * n_inputs;
    double *next = system->memory = own_doubles(system, system->n_memory);
#define MOVE(pointer, values, count)                                         \
    do {                                                                     \
        if ((count) > 0) memcpy(next, values, (size_t)(count) * sizeof *next); \
        (pointer) = next;                                                    \
        next += (count);                                                     \
    } while (0)
    for (int32_t v = 0; v < system->n_stores; v++) MOVE(stores[v], s->stores[v], n);
    MOVE(s->at, s->at, n_instances);
    MOVE(s->before, s->before, n_instances);
    MOVE(s->taken, s->taken, n_inputs);
    MOVE(s->taken_at, s->taken_at, n_inputs);
    MOVE(s->largest, s->largest, n);
#undef MOVE
    s->stores = own_copy(system, stores, system->n_stores, sizeof *stores);
}

static void build_vectors(System *system, int32_t n_inputs) {
    Dice *dice = &system->dice;
    Stepper *s = &system->stepper;
    double *stores[MOST_STORES];
    const int32_t n = system->n_instances;
    const double begin = (s->clock.first + (double)system->first * s->clock.per_step) / s->clock.denominator;
    system->n_stores = between(dice, FIRST_STORE + N_SPANS, MOST_STORES);
    s->first_span = system->n_stores - N_SPANS;
    for (int32_t v = 0; v < system->n_stores; v++) stores[v] = own_random(system, s->n_signals);
    s->stores = own_copy(system, stores, system->n_stores, sizeof *stores);
    s->at = own_equal(system, n, begin);
    s->before = own_equal(system, n, begin - (happens(dice, 0.5) ? system->step : 0.0));
    s->input_values = own_doubles(system, n_inputs);
    s->derivatives = own_doubles(system, n_inputs);
    s->taken = own_random(system, n_inputs);
    s->taken_at = own_equal(system, n_inputs, begin);
    s->largest = own_equal(system, s->n_signals, 0.0);
    if (system->is_controlled) gather_memory(system, n_inputs);
}

static void build_observers(System *system, Draft *draft) {
    Dice *dice = &system->dice;
    Stepper *s = &system->stepper;
    Calls list = {.n = 0};
    int32_t first = 0;
    for (int32_t i = 0; i < system->n_instances; i++) {
        draft->n_observed[i] = happens(dice, 0.5) ? below(dice, MOST_VALUES + 1) : 0;
        s->n_observed += draft->n_observed[i];
    }
    s->observed = own_doubles(system, s->n_observed);
    for (int32_t i = 0; i < system->n_instances; i++) {
        const int32_t count = draft->n_observed[i];
        add_calls(system, &list, i, draft->instances[i].is_version_3, OBSERVING, s->observed, first, count, 0);
        first += count;
    }
    s->observers = own_copy(system, list.calls, list.n, sizeof(Call));
    s->n_observers = list.n;
}

static void build_read(System *system) {
    Stepper *s = &system->stepper;
    int32_t read[MOST_INSTANCES * MOST_VALUES];
    for (int32_t k = 0; k < s->n_signals; k++)
        if (happens(&system->dice, 0.8)) read[s->n_read++] = k;
    s->read = own_copy(system, read, s->n_read, sizeof *read);
}

/* Copy the draft into tables of exactly the right size. */
static void build_tables(System *system, const Draft *draft) {
    Stepper *s = &system->stepper;
    int32_t follows[MOST_INSTANCES] = {0};
    for (int32_t j = 0; j < draft->n_inputs; j++)
        for (int32_t i = 0; i < system->n_instances; i++) {
            const FmuInstance *instance = &draft->instances[i];
            const int is_its = j >= instance->first_input && j < instance->first_input + instance->n_inputs;
            if (is_its && draft->inputs[j].known == KNOWN_MEAN) follows[i] = i % 2;
        }
    s->follows = own_copy(system, follows, system->n_instances, sizeof *follows);
    s->instances = own_copy(system, draft->instances, system->n_instances, sizeof(FmuInstance));
    s->inputs = own_copy(system, draft->inputs, draft->n_inputs, sizeof(Input));
    s->signals = own_copy(system, draft->signals, s->n_signals, sizeof(Signal));
    s->groups = own_copy(system, draft->groups, s->n_groups, sizeof(Group));
    s->operations = own_copy(system, draft->operations, s->n_operations, sizeof(Operation));
    s->combinations = own_copy(system, draft->combinations, draft->n_combinations, sizeof(Combination));
    s->terms = own_copy(system, draft->terms, draft->n_terms, sizeof(Term));
}

static void build_switches(System *system) {
    Stepper *s = &system->stepper;
    if (happens(&system->dice, 0.7)) {
        s->activity = system->activity = own(system, 1, sizeof(Activity));
        memset(system->activity, 0, sizeof(Activity));
    }
    if (happens(&system->dice, 0.7)) {
        s->stop = system->stop = own(system, 1, sizeof *system->stop);
        *system->stop = 0;
    }
}

/* Return the system of a seed, for fixed steps or for error control; free_system frees it. */
static System *build_system(uint64_t seed, int32_t is_controlled) {
    System *system = calloc(1, sizeof *system);
    Draft *draft = calloc(1, sizeof *draft);
    if (system == NULL || draft == NULL) abort();
    Stepper *s = &system->stepper;
    system->is_controlled = is_controlled;
    system->dice.state = seed;
    system->ways.state = ~seed;
    system->ticks.state = seed ^ 0x5555555555555555u;
    present_system = system;
    system->n_instances = between(&system->dice, 1, MOST_INSTANCES);
    system->toys = own(system, (size_t)system->n_instances, sizeof(Toy));
    system->states = own(system, (size_t)system->n_instances, sizeof(SavedState));
    system->trial_states = own(system, (size_t)system->n_instances, sizeof(SavedState));
    for (int32_t i = 0; i < system->n_instances; i++)
        system->states[i] = system->trial_states[i] = (SavedState){NULL, NULL};
    draw_times(system);
    s->sweeps = between(&system->dice, 1, 8);
    s->halvings = below(&system->dice, 4);
    s->coupling_tolerance = happens(&system->dice, 0.5) ? 1e-6 : 1e-3;
    s->n_groups = happens(&system->dice, 0.6) ? between(&system->dice, 1, MOST_GROUPS) : 0;
    for (int32_t g = 0; g < s->n_groups; g++) draft->is_saved[g] = happens(&system->dice, 0.8);
    for (int32_t i = 0; i < system->n_instances; i++) draft_instance(system, draft, i);
    for (int32_t i = 0; i < system->n_instances; i++) draft_inputs(system, draft, i);
    build_vectors(system, draft->n_inputs);
    for (int32_t i = 0; i < system->n_instances; i++) finish_instance(system, draft, i);
    for (int32_t g = 0; g < s->n_groups; g++) finish_group(system, draft, g);
    draft_program(system, draft);
    build_observers(system, draft);
    draw_faults(system, draft);
    build_toys(system, draft);
    build_read(system);
    build_tables(system, draft);
    build_switches(system);
    free(draft);
    return system;
}

static void free_system(System *system) {
    for (int32_t i = 0; i < system->n_instances; i++) {
        SavedState *places[] = {&system->states[i], &system->trial_states[i]};
        for (int p = 0; p < 2; p++)
            if (places[p]->state != NULL) free_state_of_toy(&system->toys[i], &places[p]->state);
    }
    REQUIRE(system->n_saved == 0, "a saved state is lost");
    for (size_t n = 0; n < system->n_owned; n++) free(system->owned[n]);
    free(system);
}

#endif
