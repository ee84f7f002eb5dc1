/* Values and derivatives of a program whose repeated terms are small functions of many instances.

   A function is a list of steps on scalars. A block of instances goes through all steps before the next block does, so
   that its numbers stay in the processor's nearest memory; each step is one loop over the block, which the compiler
   vectorises. What a step costs beside its arithmetic is shared by all instances of the block. Variables are read from
   x, and results are added to the rows or entries they belong to, within the same pass.

   All arrays belong to the caller (vectorised evaluation in Python, which describes them in `compiled_terms.py`); a
   program is only read here, so that several threads may evaluate it. Names of operations are those of CasADi. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

/* The same arithmetic in wider registers where the processor has them; the results are the same. */
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__gnu_linux__)
#define WIDEST_REGISTERS __attribute__((target_clones("avx2", "default")))
#else
#define WIDEST_REGISTERS
#endif

enum { BLOCK = 64 };

enum Operation {
    READ_VARIABLE, READ_NUMBER, READ_WEIGHT, CONSTANT, ADD_OUTPUT,
    ADD, SUB, MUL, DIV, NEG, INV, SQ, TWICE, SQRT, POW, EXP, LOG, LOG1P, EXPM1, SIN, COS, TAN, ASIN, ACOS, ATAN, ATAN2,
    SINH, COSH, TANH, ASINH, ACOSH, ATANH, FABS, SIGN, COPYSIGN, FLOOR, CEIL, FMOD, FMIN, FMAX, HYPOT, LT, LE, EQ, NE,
    NOT, AND, OR, ASSIGN, IF_ELSE_ZERO
};

/* work[result] = operation(work[first], work[second]). Where something is read, `first` is its place among the
   variables, numbers, weights or constants; where an output is added, `result` is its place among the outputs. */
typedef struct {
    int32_t operation, result, first, second;
} Step;

typedef struct {
    int64_t steps;
    const Step *step;
    const double *constants;
    int64_t work;
    const int32_t *places; /* [output][instance]: where each value is added */
    const double *scales;  /* [output][instance]: the factors it is added with; NULL for ones */
} Function;

typedef struct {
    int64_t instances;
    const int32_t *columns; /* [variable][instance] */
    const double *numbers;  /* [number][instance] */
    const int32_t *rows;    /* [weight][instance] */
    const double *scales;   /* [weight][instance] */
    Function functions[3];
} Term;

enum { VALUE, GRADIENT, HESSIAN };

/* Rows that are each a constant, a linear function and some terms. */
typedef struct {
    int64_t rows, entries, terms;
    const Term *term;
    const double *offsets;         /* [row] */
    const int64_t *linear_starts;  /* [row + 1]: where the linear part of each row begins and ends */
    const int32_t *linear_columns;
    const double *linear_coefficients;
    const double *constant_entries; /* [entry]: the part of the Jacobian that never changes */
    int64_t work;                   /* the most that one of the functions needs */
} Sums;

typedef struct {
    int64_t n;
    Sums cost, rows;
    const int32_t *gradient_columns; /* [entry of cost] */
} Program;

#define FOR_EACH for (int64_t i = 0; i < count; i++)
/* The same where no result is read by another instance, which a compiler cannot know of two pointers. */
#if defined(__clang__)
#define FOR_ALL _Pragma("clang loop vectorize(assume_safety)") FOR_EACH
#elif defined(__GNUC__)
#define FOR_ALL _Pragma("GCC ivdep") FOR_EACH
#else
#define FOR_ALL FOR_EACH
#endif
#define UNARY(name, expression) case name: FOR_EACH { const double u = a[i]; r[i] = (expression); } break
#define BINARY(name, expression) case name: FOR_EACH { const double u = a[i], v = b[i]; r[i] = (expression); } break

/* One operation on `count` numbers. The result may stand in the place of an argument. */
WIDEST_REGISTERS
static void operate(int32_t operation, int64_t count, double *r, const double *a, const double *b) {
    switch (operation) {
    case ADD: FOR_ALL r[i] = a[i] + b[i]; break;
    case SUB: FOR_ALL r[i] = a[i] - b[i]; break;
    case MUL: FOR_ALL r[i] = a[i] * b[i]; break;
    case DIV: FOR_ALL r[i] = a[i] / b[i]; break;
    case NEG: FOR_ALL r[i] = -a[i]; break;
    case INV: FOR_ALL r[i] = 1.0 / a[i]; break;
    case SQ: FOR_ALL r[i] = a[i] * a[i]; break;
    case TWICE: FOR_ALL r[i] = a[i] + a[i]; break;
    case SQRT: FOR_ALL r[i] = sqrt(a[i]); break;
    case FABS: FOR_ALL r[i] = fabs(a[i]); break;
    BINARY(POW, pow(u, v));
    UNARY(EXP, exp(u));
    UNARY(LOG, log(u));
    UNARY(LOG1P, log1p(u));
    UNARY(EXPM1, expm1(u));
    UNARY(SIN, sin(u));
    UNARY(COS, cos(u));
    UNARY(TAN, tan(u));
    UNARY(ASIN, asin(u));
    UNARY(ACOS, acos(u));
    UNARY(ATAN, atan(u));
    BINARY(ATAN2, atan2(u, v));
    UNARY(SINH, sinh(u));
    UNARY(COSH, cosh(u));
    UNARY(TANH, tanh(u));
    UNARY(ASINH, asinh(u));
    UNARY(ACOSH, acosh(u));
    UNARY(ATANH, atanh(u));
    UNARY(SIGN, u > 0.0 ? 1.0 : u < 0.0 ? -1.0 : u); /* nan of nan, as NumPy has it */
    BINARY(COPYSIGN, copysign(u, v));
    UNARY(FLOOR, floor(u));
    UNARY(CEIL, ceil(u));
    BINARY(FMOD, fmod(u, v));
    BINARY(FMIN, fmin(u, v));
    BINARY(FMAX, fmax(u, v));
    BINARY(HYPOT, hypot(u, v));
    BINARY(LT, u < v ? 1.0 : 0.0);
    BINARY(LE, u <= v ? 1.0 : 0.0);
    BINARY(EQ, u == v ? 1.0 : 0.0);
    BINARY(NE, u != v ? 1.0 : 0.0);
    UNARY(NOT, u == 0.0 ? 1.0 : 0.0);
    BINARY(AND, u != 0.0 && v != 0.0 ? 1.0 : 0.0);
    BINARY(OR, u != 0.0 || v != 0.0 ? 1.0 : 0.0);
    UNARY(ASSIGN, u);
    BINARY(IF_ELSE_ZERO, u != 0.0 ? v : 0.0);
    default: FOR_EACH r[i] = NAN; /* refused by the caller; never a silent number */
    }
}

/* Add the outputs of one function, for all instances of a term, to `sums`. */
static void add_function(const Term *term, const Function *function, const double *x, const double *weights,
                         double *work, double *sums) {
    const int64_t instances = term->instances;
    for (int64_t first = 0; first < instances; first += BLOCK) {
        const int64_t count = instances - first < BLOCK ? instances - first : BLOCK;
        for (int64_t k = 0; k < function->steps; k++) {
            const Step step = function->step[k];
            double *r = work + (int64_t)step.result * BLOCK;
            const double *a = work + (int64_t)step.first * BLOCK;
            const int64_t from = (int64_t)step.first * instances + first;
            switch (step.operation) {
            case READ_VARIABLE: {
                const int32_t *column = term->columns + from;
                FOR_EACH r[i] = x[column[i]];
                break;
            }
            case READ_NUMBER:
                memcpy(r, term->numbers + from, (size_t)count * sizeof(double));
                break;
            case READ_WEIGHT: {
                const int32_t *row = term->rows + from;
                const double *scale = term->scales + from;
                FOR_EACH r[i] = weights[row[i]] * scale[i];
                break;
            }
            case CONSTANT:
                FOR_EACH r[i] = function->constants[step.first];
                break;
            case ADD_OUTPUT: {
                const int64_t to = (int64_t)step.result * instances + first;
                const int32_t *place = function->places + to;
                if (function->scales) {
                    const double *scale = function->scales + to;
                    FOR_EACH sums[place[i]] += scale[i] * a[i];
                } else {
                    FOR_EACH sums[place[i]] += a[i];
                }
                break;
            }
            default:
                operate(step.operation, count, r, a, work + (int64_t)step.second * BLOCK);
            }
        }
    }
}

/* The functions below return 0 where memory is short, else 1. */

/* Add the outputs of one function of each term to `to`. */
static int32_t add_terms(const Sums *sums, int which, const double *x, const double *weights, double *to) {
    double *work = malloc((size_t)sums->work * BLOCK * sizeof(double));
    if (!work) return 0;
    for (int64_t k = 0; k < sums->terms; k++)
        add_function(sums->term + k, sums->term[k].functions + which, x, weights, work, to);
    free(work);
    return 1;
}

EXPORTED int32_t sums_values(const Sums *sums, const double *x, double *values) {
    for (int64_t i = 0; i < sums->rows; i++) {
        double sum = 0.0;
        for (int64_t k = sums->linear_starts[i]; k < sums->linear_starts[i + 1]; k++)
            sum += sums->linear_coefficients[k] * x[sums->linear_columns[k]];
        values[i] = sum;
    }
    const int32_t done = add_terms(sums, VALUE, x, NULL, values);
    for (int64_t i = 0; i < sums->rows; i++) values[i] = sums->offsets[i] + values[i];
    return done;
}

EXPORTED int32_t sums_jacobian(const Sums *sums, const double *x, double *entries) {
    memcpy(entries, sums->constant_entries, (size_t)sums->entries * sizeof(double));
    return add_terms(sums, GRADIENT, x, NULL, entries);
}

/* The entries are added to what `entries` holds. */
EXPORTED int32_t sums_hessian(const Sums *sums, const double *x, const double *weights, double *entries) {
    return add_terms(sums, HESSIAN, x, weights, entries);
}

/* ------------------------------------------------------------------ Ipopt's own calls, without Python in between */

/* A program in the units of `x_scales` and so on (as `ScaledProgram` has them), and what happened in one run. */
typedef struct {
    const Program *program;
    const double *shifts; /* [row]: what is added to the rows, or NULL; it may change between evaluations */
    const double *x_scales, *gradient_scales, *row_scales, *entry_scales, *hessian_scales; /* NULL for ones */
    double objective_scale;
    double *x, *multipliers;  /* memory for the point and the multipliers in the program's units */
    double *undefined_at;     /* [n]: the last point where something did not exist */
    int32_t undefined;        /* whether there was one */
    const int32_t *jacobian_rows, *jacobian_columns, *hessian_rows, *hessian_columns;
} Run;

static const double *unscaled_point(Run *run, const double *x) {
    if (!run->x_scales) return x;
    for (int64_t i = 0; i < run->program->n; i++) run->x[i] = run->x_scales[i] * x[i];
    return run->x;
}

/* v - v is 0 for every finite v, and nan for all others. Several sums do not wait for each other. */
WIDEST_REGISTERS
static int32_t all_finite(const double *values, int64_t count) {
    double sums[16] = {0.0};
    int64_t k = 0;
    for (; k + 16 <= count; k += 16)
        for (int64_t i = 0; i < 16; i++) sums[i] += values[k + i] - values[k + i];
    for (; k < count; k++) sums[0] += values[k] - values[k];
    for (int64_t i = 1; i < 16; i++) sums[0] += sums[i];
    return sums[0] == 0.0;
}

/* Multiply numbers by their factors, if there are any, and tell whether all exist; where not, the point is remembered, and
   Ipopt is told to take a shorter step. */
static int32_t noted(Run *run, int32_t done, const double *x, double *values, int64_t count, const double *factors) {
    if (factors)
        for (int64_t i = 0; i < count; i++) values[i] *= factors[i];
    const int32_t exists = done && all_finite(values, count);
    if (!exists) {
        memcpy(run->undefined_at, x, (size_t)run->program->n * sizeof(double));
        run->undefined = 1;
    }
    return exists;
}

EXPORTED int32_t run_objective(int32_t n, const double *x, int32_t new_x, double *value, Run *run) {
    const int32_t done = sums_values(&run->program->cost, unscaled_point(run, x), value);
    (void)n, (void)new_x;
    *value /= run->objective_scale;
    return noted(run, done, x, value, 1, NULL);
}

EXPORTED int32_t run_gradient(int32_t n, const double *x, int32_t new_x, double *values, Run *run) {
    const Sums *cost = &run->program->cost;
    (void)new_x;
    memset(values, 0, (size_t)n * sizeof(double));
    double *entries = malloc((size_t)(cost->entries + 1) * sizeof(double));
    const int32_t done = entries && sums_jacobian(cost, unscaled_point(run, x), entries);
    for (int64_t k = 0; done && k < cost->entries; k++) values[run->program->gradient_columns[k]] = entries[k];
    free(entries);
    return noted(run, done, x, values, n, run->gradient_scales);
}

EXPORTED int32_t run_constraints(int32_t n, const double *x, int32_t new_x, int32_t m, double *values, Run *run) {
    const int32_t done = sums_values(&run->program->rows, unscaled_point(run, x), values);
    (void)n, (void)new_x;
    if (run->shifts)
        for (int32_t i = 0; i < m; i++) values[i] += run->shifts[i];
    if (run->row_scales)
        for (int32_t i = 0; i < m; i++) values[i] /= run->row_scales[i];
    return noted(run, done, x, values, m, NULL);
}

EXPORTED int32_t run_jacobian(int32_t n, const double *x, int32_t new_x, int32_t m, int32_t count, int32_t *rows,
                              int32_t *columns, double *values, Run *run) {
    (void)n, (void)new_x, (void)m;
    if (!values) {
        memcpy(rows, run->jacobian_rows, (size_t)count * sizeof(int32_t));
        memcpy(columns, run->jacobian_columns, (size_t)count * sizeof(int32_t));
        return 1;
    }
    const int32_t done = sums_jacobian(&run->program->rows, unscaled_point(run, x), values);
    return noted(run, done, x, values, count, run->entry_scales);
}

EXPORTED int32_t run_hessian(int32_t n, const double *x, int32_t new_x, double factor, int32_t m,
                             const double *multipliers, int32_t new_multipliers, int32_t count, int32_t *rows,
                             int32_t *columns, double *values, Run *run) {
    (void)n, (void)new_x, (void)new_multipliers;
    if (!values) {
        memcpy(rows, run->hessian_rows, (size_t)count * sizeof(int32_t));
        memcpy(columns, run->hessian_columns, (size_t)count * sizeof(int32_t));
        return 1;
    }
    const double *own = multipliers;
    if (run->row_scales) {
        for (int32_t i = 0; i < m; i++) run->multipliers[i] = multipliers[i] / run->row_scales[i];
        own = run->multipliers;
    }
    const double *point = unscaled_point(run, x), weight = factor / run->objective_scale;
    memset(values, 0, (size_t)count * sizeof(double));
    const int32_t done = sums_hessian(&run->program->cost, point, &weight, values) &&
                         sums_hessian(&run->program->rows, point, own, values);
    return noted(run, done, x, values, count, run->hessian_scales);
}
