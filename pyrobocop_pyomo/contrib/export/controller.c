/* The steps of a receding horizon; see controller.h. What belongs to one problem is in the part "The problem". */

#define _GNU_SOURCE /* for dladdr */
#include <dlfcn.h>

#include "controller.h"
#include "term_evaluation.c"

/* ---------------------------------------------------------------------- What a measured state changes in a program */

/* What is added to the constant of a row: a factor times a measured state, or where `state` is -1 the factor. */
typedef struct {
    int32_t row, state;
    double factor;
} Given;

/* A number of a term that is a measured state. */
typedef struct {
    double *number;
    int32_t state;
} Place;

/* A variable of the rest of a plan gets a weight times a variable of the plan, times a state of the last measurement
   (`from` counts on after the variables), or where `from` is -1 the weight. */
typedef struct {
    int32_t to, from;
    double weight;
} Move;

typedef struct {
    const char *name;
    enum { TEXT, INTEGER, REAL, THIS_LIBRARY } kind;
    const char *text;
    double number;
} Option;

/* Ipopt's C interface, whose header differs between versions in the names of its types only. */
typedef struct IpoptProblemInfo *Ipopt;
extern Ipopt CreateIpoptProblem(
    int, const double *, const double *, int, const double *, const double *, int, int, int,
    int32_t (*)(int32_t, const double *, int32_t, double *, Run *),
    int32_t (*)(int32_t, const double *, int32_t, int32_t, double *, Run *),
    int32_t (*)(int32_t, const double *, int32_t, double *, Run *),
    int32_t (*)(int32_t, const double *, int32_t, int32_t, int32_t, int32_t *, int32_t *, double *, Run *),
    int32_t (*)(int32_t, const double *, int32_t, double, int32_t, const double *, int32_t, int32_t, int32_t *,
                int32_t *, double *, Run *));
extern void FreeIpoptProblem(Ipopt);
extern _Bool AddIpoptStrOption(Ipopt, const char *, const char *);
extern _Bool AddIpoptNumOption(Ipopt, const char *, double);
extern _Bool AddIpoptIntOption(Ipopt, const char *, int);
extern int IpoptSolve(Ipopt, double *, double *, double *, double *, double *, double *, Run *);

/* ---------------------------------------------------------------------------------------------------- The problem */

#include "problem.c"

/* -------------------------------------------------------------------------------------------------------- A step */

enum { NO_MEMORY = -102, INVALID_OPTION = -12 };

const int controller_states = STATES, controller_controls = CONTROLS, controller_variables = VARIABLES;

static double run_x[VARIABLES], run_multipliers[ROWS + 1], undefined_at[VARIABLES];
static Run run = {
    .program = &program, .objective_scale = 1.0, .x = run_x, .multipliers = run_multipliers,
    .undefined_at = undefined_at, .jacobian_rows = jacobian_rows, .jacobian_columns = jacobian_columns,
    .hessian_rows = hessian_rows, .hessian_columns = hessian_columns,
};
static Ipopt problem;
static int warm_problem; /* whether `problem` has the options of a warm start */

static void set_offsets(double *offsets, const double *constants, int64_t rows, const Given *given, int64_t count,
                        const double *state) {
    for (int64_t i = 0; i < rows; i++) offsets[i] = 0.0;
    for (int64_t k = 0; k < count; k++)
        offsets[given[k].row] += given[k].state < 0 ? given[k].factor : given[k].factor * state[given[k].state];
    for (int64_t i = 0; i < rows; i++) offsets[i] = constants[i] + offsets[i];
}

static void set_state(const double *state) {
    set_offsets(cost_offsets, cost_constants, 1, cost_given, COST_GIVEN, state);
    set_offsets(row_offsets, row_constants, ROWS, row_given, ROW_GIVEN, state);
    for (int64_t k = 0; k < PLACES; k++) *places[k].number = state[places[k].state];
}

/* The rest of the last plan, from which the first point of a solve is made. */
static void move_ahead(double *x) {
    memcpy(x, plan, sizeof plan);
    for (int64_t k = 0; k < MOVES; k++) x[moves[k].to] = 0.0;
    for (int64_t k = 0; k < MOVES; k++) {
        const int32_t from = moves[k].from;
        const double value = from < 0 ? 1.0 : from < VARIABLES ? plan[from] : measured[from - VARIABLES];
        x[moves[k].to] += moves[k].weight * value;
    }
}

static int set_options(const Option *options, int64_t count) {
    for (int64_t k = 0; k < count; k++) {
        const Option *option = options + k;
        Dl_info here;
        int accepted = 0;
        switch (option->kind) {
        case TEXT: accepted = AddIpoptStrOption(problem, option->name, option->text); break;
        case INTEGER: /* which may stand for a real number */
            accepted = AddIpoptIntOption(problem, option->name, (int)option->number) ||
                       AddIpoptNumOption(problem, option->name, option->number);
            break;
        case REAL: accepted = AddIpoptNumOption(problem, option->name, option->number); break;
        case THIS_LIBRARY: /* the linear solver is compiled into it */
            accepted = dladdr(&program, &here) && AddIpoptStrOption(problem, option->name, here.dli_fname);
        }
        if (!accepted) return 0;
    }
    return 1;
}

/* 0, or the status of a problem that cannot be made. */
static int open_problem(void) {
    if (problem && warm_problem == planned) return 0;
    if (problem) FreeIpoptProblem(problem);
    warm_problem = planned;
    problem = CreateIpoptProblem(VARIABLES, x_lower, x_upper, ROWS, g_lower, g_upper, JACOBIAN_ENTRIES, HESSIAN_ENTRIES,
                                 0, run_objective, run_constraints, run_gradient, run_jacobian, run_hessian);
    if (!problem) return NO_MEMORY;
    if (set_options(planned ? warm_options : cold_options, planned ? WARM_OPTIONS : COLD_OPTIONS)) return 0;
    FreeIpoptProblem(problem);
    problem = NULL;
    return INVALID_OPTION;
}

int controller_step(const double *state, double *control) {
    static double start[VARIABLES], x[VARIABLES], g[ROWS + 1], rows[ROWS + 1], lower[VARIABLES], upper[VARIABLES];
    double objective;
    set_state(state);
    if (planned)
        move_ahead(start);
    else
        memcpy(start, plan, sizeof plan);
    memcpy(measured, state, sizeof measured);
    memcpy(x, start, sizeof plan);
    memcpy(rows, row_multipliers, sizeof rows);
    memcpy(lower, lower_multipliers, sizeof lower);
    memcpy(upper, upper_multipliers, sizeof upper);
    int status = open_problem();
    if (status == 0) status = IpoptSolve(problem, x, g, &objective, rows, lower, upper, &run);
    const int solved = status == 0 || status == 1 || status == 6;
    memcpy(plan, solved ? x : start, sizeof plan);
    if (solved) {
        memcpy(row_multipliers, rows, sizeof rows);
        memcpy(lower_multipliers, lower, sizeof lower);
        memcpy(upper_multipliers, upper, sizeof upper);
        planned = 1;
    }
    for (int64_t k = 0; k < CONTROLS; k++) control[k] = plan[first_controls[k]];
    return status;
}

const double *controller_plan(void) { return plan; }
