/* Data over time as the outputs of an FMU, instead of generated equations.
 *
 * The data are one array of doubles, read from the FMU's resources by resource.h and written by
 * layout.py: a head, the kind of every column, four numbers for every output, the times of the
 * rows, the rows themselves, and an index of them. With spans, an output also says what it did in the last step.
 */

enum { AT_GUID = 0, AT_ROWS = 5, AT_COLUMNS, AT_OUTPUTS, AT_END, AT_SPANS, AT_TABLES }; /* the head */
enum { HELD, LINEAR, CUBIC, N_KINDS };                                        /* of a column */
enum { HOLD, REPEAT, STOP, N_ENDS };                                          /* what follows the last row */
enum { COLUMN, ORDER, GAIN, OFFSET, N_OUTPUT };                               /* of an output */
enum { MAXIMUM_ORDER = 2, PER_COLUMN = 2 }; /* a row has value and slope of every column */
enum { SPAN_BEGIN = 1, SPAN_END, SPAN_MEAN, PER_OUTPUT };  /* what follows the outputs, if there are spans */

typedef struct {
    size_t rows, columns, outputs;
    int end;
    int has_spans; /* whether all outputs tell what they did in the last step, too */
    const double *kinds, *shown, *times, *values, *index;
} Table;

static Table table_of(const double *data) {
    Table t;
    t.rows = (size_t)data[AT_ROWS];
    t.columns = (size_t)data[AT_COLUMNS];
    t.outputs = (size_t)data[AT_OUTPUTS];
    t.end = (int)data[AT_END];
    t.has_spans = (int)data[AT_SPANS];
    t.kinds = data + AT_TABLES;
    t.shown = t.kinds + t.columns;
    t.times = t.shown + N_OUTPUT * t.outputs;
    t.values = t.times + t.rows;
    t.index = t.values + PER_COLUMN * t.columns * t.rows;
    return t;
}

/* A row, and how far a time is behind it; the data rest before the first row and after the last. */
typedef struct {
    size_t row;
    double behind;
    int rests;
} Place;

/* The last row that is not after a time between the first and the last one. The index divides the time
 * into as many equal parts as there are rows, so that evenly spaced rows need no search.
 */
static size_t row_at(const Table *t, double time) {
    const double first = t->times[0], last = t->times[t->rows - 1];
    const double part = (time - first) / (last - first) * (double)t->rows;
    const size_t slot = part < (double)(t->rows - 1) ? (size_t)part : t->rows - 1;
    size_t low = (size_t)t->index[slot];
    size_t high = slot + 1 < t->rows ? (size_t)t->index[slot + 1] + 1 : t->rows - 1;
    while (low > 0 && t->times[low] > time) low--;
    while (high < t->rows - 1 && t->times[high] <= time) high++;
    while (high - low > 1) {
        const size_t middle = low + (high - low) / 2;
        if (t->times[middle] <= time) low = middle;
        else high = middle;
    }
    return low;
}

/* Times that differ by less differ only by rounding. */
static double rounding_at(const Table *t, double time) {
    return TIME_ROUNDING * fmax(fabs(time), fmax(fabs(t->times[0]), fabs(t->times[t->rows - 1])));
}

/* The place of a time that is seen later by `shift`, or earlier if it is negative. */
static Place shifted_place(const Table *t, double time, double shift) {
    const double first = t->times[0], last = t->times[t->rows - 1];
    double seen = time + shift;
    if (seen < first) return (Place){0, 0.0, 1};
    if (t->end == REPEAT && seen >= last) {
        seen = first + fmod(seen - first, last - first);
        if (seen >= last) seen = first; /* by rounding */
        time = seen - shift;
    }
    if (seen >= last) return (Place){t->rows - 1, 0.0, 1};
    const size_t row = row_at(t, seen);
    const double behind = time - t->times[row];
    return (Place){row, behind > fabs(shift) ? behind : 0.0, 0};
}

/* Where data are at a time, and right after it if they jump there. */
static Place place_of(const Table *t, double time) { return shifted_place(t, time, rounding_at(t, time)); }

/* Where they are right before it. */
static Place place_before(const Table *t, double time) {
    return shifted_place(t, time, -rounding_at(t, time));
}

/* A column's value, or its time derivative of an order up to 3. */
static double value_of(const Table *t, size_t column, int order, const Place *place) {
    const double *y = t->values + PER_COLUMN * (place->row * t->columns + column);
    const int kind = (int)t->kinds[column];
    if (place->rests || kind == HELD) return order == 0 ? y[0] : 0.0;
    const double *next = y + PER_COLUMN * t->columns;
    const double s = place->behind, h = t->times[place->row + 1] - t->times[place->row];
    const double slope = (next[0] - y[0]) / h;
    if (kind == LINEAR) return order == 0 ? slope * s + y[0] : order == 1 ? slope : 0.0;
    const double second = (3.0 * slope - 2.0 * y[1] - next[1]) / h, third = (y[1] + next[1] - 2.0 * slope) / (h * h);
    switch (order) {
        case 0: return y[0] + s * (y[1] + s * (second + s * third));
        case 1: return y[1] + s * (2.0 * second + 3.0 * s * third);
        case 2: return 2.0 * second + 6.0 * s * third;
        default: return 6.0 * third;
    }
}

/* ---- what an output did in a step ------------------------------------------------------ */

/* Whoever reads an output during a step needs no guess: its line from `begin` to `end`, or its mean. In a step
 * with a jump inside, the line is the mean, so that the jump has the effect of its time.
 */
typedef struct {
    double begin, end, mean;
} Span;

#define JUMP 1e-9 /* of the values: a smaller difference is a rounding error */

/* The mean over a piece from a place on in which no row begins: Simpson's rule is exact for cubic polynomials. */
static double piece_mean(const Table *t, size_t column, int order, Place place, double length) {
    const double begin = value_of(t, column, order, &place);
    if (place.rests || (int)t->kinds[column] == HELD) return begin;
    place.behind += 0.5 * length;
    const double middle = value_of(t, column, order, &place);
    place.behind += 0.5 * length;
    return (begin + 4.0 * middle + value_of(t, column, order, &place)) / 6.0;
}

/* Whether a column jumps where a piece of this length ends and another place begins. */
static int jumps(const Table *t, size_t column, int order, Place place, double length, const Place *next) {
    place.behind += length;
    const double before = value_of(t, column, order, &place), after = value_of(t, column, order, next);
    const double size = fabs(t->values[PER_COLUMN * (place.row * t->columns + column)]);
    return fabs(after - before) > JUMP * (size + fabs(before) + fabs(after));
}

/* The length of the piece from a place at `time` on: until the next row, at most until `end`. */
static double piece_length(const Table *t, const Place *place, double time, double end) {
    double length = end - time;
    if (!place->rests) length = fmin(length, t->times[place->row + 1] - t->times[place->row] - place->behind);
    else if (time < t->times[0]) length = fmin(length, t->times[0] - time);
    return fmax(length, nextafter(time, HUGE_VAL) - time);
}

/* The span of a column over rows within a step, from place to place. */
static Span span_over_rows(const Table *t, size_t column, int order, double begin, double end, Span span) {
    const double stop = end - rounding_at(t, end);
    double time = begin, sum = 0.0;
    int has_jump = 0;
    Place place = place_of(t, begin);
    for (;;) {
        const double length = piece_length(t, &place, time, end);
        sum += length * piece_mean(t, column, order, place, length);
        time += length;
        if (time >= stop) break;
        const Place next = place_of(t, time);
        has_jump = has_jump || jumps(t, column, order, place, length, &next);
        place = next;
    }
    span.mean = sum / (end - begin);
    if (has_jump) span.begin = span.end = span.mean;
    return span;
}

/* What a column did between two times; at a jump, its value after `begin` and before `end`. */
static Span span_of(const Table *t, size_t column, int order, double begin, double end) {
    const Place first = place_of(t, begin), last = place_before(t, end);
    Span span = {value_of(t, column, order, &first), value_of(t, column, order, &last), 0.0};
    const double length = end - begin, behind = last.behind - first.behind;
    const int is_piece = first.row == last.row && first.rests == last.rests &&
                         (first.rests || fabs(behind - length) <= 4.0 * rounding_at(t, end));
    if (!(length > 0.0)) span.end = span.mean = span.begin;
    else if (is_piece) span.mean = piece_mean(t, column, order, first, length);
    else span = span_over_rows(t, column, order, begin, end, span);
    return span;
}

/* ---- instead of generated.h ------------------------------------------------------------ */

#define N_FIXED 0
#define N_STEPWISE 0

/* The outputs at `time`, and their spans from `begin` on. */
static void outputs_since(double begin, double time, const double *data, double *result) {
    const Table t = table_of(data);
    const Place place = place_of(&t, time);
    for (size_t i = 0; i < t.outputs; i++) {
        const double *shown = t.shown + N_OUTPUT * i, gain = shown[GAIN], offset = shown[OFFSET];
        const size_t column = (size_t)shown[COLUMN];
        const int order = (int)shown[ORDER];
        result[i] = gain * value_of(&t, column, order, &place) + offset;
        if (!t.has_spans) continue;
        const Span span = span_of(&t, column, order, begin, time);
        result[SPAN_BEGIN * t.outputs + i] = gain * span.begin + offset;
        result[SPAN_END * t.outputs + i] = gain * span.end + offset;
        result[SPAN_MEAN * t.outputs + i] = gain * span.mean + offset;
    }
}

static void outputs(double time, const double *v, const double *data, double *result) {
    (void)v;
    outputs_since(time, time, data, result);
}

/* The only discrete state is the time of the last communication point. */
static void update_and_outputs(double time, const double *v, const double *data, double *next, double *result) {
    outputs_since(v[0], time, data, result);
    next[0] = time;
}

/* Data depend on time only. */
static void outputs_tangent(double time, const double *v, const double *data, double d_time, const double *d,
                            double *result) {
    (void)v, (void)d;
    const Table t = table_of(data);
    const Place place = place_of(&t, time);
    for (size_t i = 0; i < t.outputs; i++) {
        const double *shown = t.shown + N_OUTPUT * i;
        const double rate = value_of(&t, (size_t)shown[COLUMN], (int)shown[ORDER] + 1, &place);
        result[i] = shown[GAIN] * rate * d_time;
        for (size_t k = SPAN_BEGIN; t.has_spans && k < PER_OUTPUT; k++) result[k * t.outputs + i] = 0.0;
    }
}

#define fixed_values(...)
#define stepwise_values(...)
#define derivatives(...)
#define derivatives_tangent(...)
