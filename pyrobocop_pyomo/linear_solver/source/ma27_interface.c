/* The solver behind the calling convention of MA27, with which Ipopt loads linear solvers (linear_solver=ma27,
 * hsllib=this library). The convention is public: HSL's specification of MA27, and IpMa27TSolverInterface.cpp of Ipopt,
 * which is all of it that Ipopt uses. Nothing here comes from HSL.
 *
 *   ma27id   defaults
 *   ma27ad   looks at the indices and proposes lengths of the arrays
 *   ma27bd   factors. The first call of a structure orders and plans, since only here the values are known. Where an
 *            array is too short, it says so and keeps the order in IKEEP, which the caller does not throw away.
 *   ma27cd   solves
 *
 * Ipopt looks for the names with and without the underscore that most compilers of Fortran add.
 *
 * IKEEP: state, times that the order was given up, order (~row where the next row is tied to it), and what the plan has as
 * `used`, and what a factorisation cost whose order was given up.  IW: the plan, then the records of the fronts.  A: the entries, then the factor.
 *
 * A matrix may be singular and have more negative eigenvalues than the caller accepts. Ipopt adds to the lower diagonal
 * for the one and to the upper for the other, and with the first of both alone the second gets harder to mend. So it hears
 * of too many negative eigenvalues first: more than the last matrix had that it solved with. ICNTL(30) = 0 forbids that.
 */
#include "exported.h"
#include "symmetric_solver.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>

/* States of IKEEP(1); numbers that do not stand there by chance. */
enum { UNKNOWN = 0, ORDERED = 713408911, PLANNED = 713408912, TOO_DEAR = 713408913 };
enum { STATE = 0, GIVEN_UP = 1, KEEP_ORDER = 2 };
static int place_of_used(int n) { return n > 1 ? KEEP_ORDER + n : KEEP_ORDER; }
/* ICNTL(30) */
enum { COUNT_FIRST = 29 };

/* What MA27's INFO(1) says of the arguments, and places in INFO. */
enum { BAD_SIZE = -1, BAD_ENTRIES = -2 };
enum { FLAG = 0, DETAIL = 1, REALS = 4, INTEGERS = 5, BLOCKS = 13, NEGATIVE = 14 };

/* Delayed pivots that cost this much more than planned make the order be given up, at most so many times, where the order
 * by the values as they are then promises to cost less by this factor. In tiny matrices that is not worth it. */
static const double DEAR = 1.5, PROMISING = 0.7;
enum { PATIENCE = 3, TINY = 8 };
static int *place_of_cost(int *ikeep, int n) { return ikeep + KEEP_ORDER + n + 1; }

static int clipped(int64_t length) { return length > INT_MAX ? INT_MAX : (int)length; }

PUBLIC void ma27id_(int *icntl, double *cntl)
{
    memset(icntl, 0, 30 * sizeof(int));
    memset(cntl, 0, 5 * sizeof(double));
    icntl[0] = icntl[1] = 6;
    icntl[3] = INT_MAX;
    icntl[COUNT_FIRST] = 1;
    cntl[0] = 0.1;
    cntl[1] = 1.0;
}

PUBLIC void ma27ad_(const int *n, const int *nz, const int *irn, const int *icn, int *iw, const int *liw, int *ikeep,
                    int *iw1, int *nsteps, const int *iflag, const int *icntl, const double *cntl, int *info,
                    double *ops)
{
    (void)iw, (void)liw, (void)iw1, (void)iflag, (void)icntl, (void)cntl;
    memset(info, 0, 20 * sizeof(int));
    *nsteps = *n > 0 ? *n : 1;
    *ops = 0.0;
    if (*n < 1) info[FLAG] = BAD_SIZE;
    else if (*nz < 0) info[FLAG] = BAD_ENTRIES;
    if (info[FLAG] != DONE) return;
    for (int k = 0; k < *nz; k++)
        if (irn[k] < 1 || irn[k] > *n || icn[k] < 1 || icn[k] > *n) {
            info[FLAG] = 1; /* ignored, as the convention has it */
            info[DETAIL]++;
        }
    ikeep[STATE] = UNKNOWN;
    ikeep[GIVEN_UP] = 0;
    ikeep[place_of_used(*n)] = 0;
    /* Ipopt multiplies both by five. */
    info[REALS] = clipped((int64_t)*nz + 2 * (int64_t)*n + 16);
    info[INTEGERS] = clipped((int64_t)*nz + 6 * (int64_t)*n + 64);
}

/* Order and plan by the values. */
static enum outcome plan_anew(int n, int nz, const int *irn, const int *icn, const double *a, int may_leave, int *order,
                              plan *made)
{
    graph g = {0, NULL, NULL};
    int *partner = malloc(sizeof(int) * ((size_t)n + 1));
    if (partner == NULL) return OUT_OF_MEMORY;
    enum outcome answer = tie_matrix(n, nz, irn, icn, a, &g, partner);
    const origin from = {n, nz, may_leave, irn, icn, partner};
    if (answer == DONE && !find_plan(&from, order, made)) {
        answer = order_tied(&g, partner, may_leave, order);
        if (answer == DONE) answer = make_plan(n, nz, irn, icn, order, made);
        if (answer == DONE) keep_plan(&from, order, made);
    }
    free_graph(&g);
    free(partner);
    return answer;
}

/* The plan for this structure at the beginning of IW. */
static enum outcome plan_into(int n, int nz, const int *irn, const int *icn, const double *a, int *iw, int64_t liw,
                              int *ikeep, int64_t *wanted)
{
    plan made;
    enum outcome answer = OUT_OF_MEMORY;
    int *order = malloc(sizeof(int) * (size_t)n);
    made.first = NULL;
    if (order == NULL) goto end;
    const int state = ikeep[STATE];
    if (state != ORDERED) {
        answer = plan_anew(n, nz, irn, icn, a, state != TOO_DEAR, order, &made);
        if (answer != DONE) goto end;
        if (state == TOO_DEAR) {
            double cost;
            memcpy(&cost, place_of_cost(ikeep, n), sizeof cost);
            if (made.expected.operations > PROMISING * cost) { /* as it was, for good */
                free_plan(&made);
                ikeep[GIVEN_UP] = PATIENCE;
                ikeep[STATE] = ORDERED;
            }
        }
    }
    if (ikeep[STATE] == ORDERED) {
        answer = make_plan(n, nz, irn, icn, ikeep + KEEP_ORDER, &made);
        if (answer != DONE) goto end;
    } else if (n > 1) { /* IKEEP has 3 n entries */
        memcpy(ikeep + KEEP_ORDER, order, sizeof(int) * (size_t)n);
        ikeep[STATE] = ORDERED;
    }
    const int64_t length = plan_length(&made);
    *wanted = length + made.integers;
    if (liw < *wanted) {
        *wanted += made.integers / 4;
        answer = SHORT_INTEGERS;
        goto end;
    }
    store_plan(&made, iw);
    ikeep[STATE] = PLANNED;
end:
    free_plan(&made);
    free(order);
    return answer;
}

PUBLIC void ma27bd_(const int *n, const int *nz, const int *irn, const int *icn, double *a, const int *la, int *iw,
                    const int *liw, int *ikeep, const int *nsteps, int *maxfrt, int *iw1, const int *icntl,
                    const double *cntl, int *info)
{
    (void)nsteps, (void)iw1;
    plan p;
    statistics told;
    int64_t wanted = 0;
    enum outcome answer = DONE;
    memset(info, 0, 20 * sizeof(int));
    *maxfrt = 1;
    int *used = ikeep + place_of_used(*n);
    if (ikeep[STATE] != PLANNED) answer = plan_into(*n, *nz, irn, icn, a, iw, *liw, ikeep, &wanted);
    if (answer == DONE) {
        view_plan(iw, &p);
        const int64_t length = plan_length(&p);
        if (p.used > 0) *used = p.used; /* the plan may be made anew, and knows nothing then */
        answer = factor(&p, a, *la, iw + length, *liw - length, cntl[0], &told);
        wanted = answer == SHORT_INTEGERS ? told.wanted + length : told.wanted;
        keep_negative(iw, told.negative, *used);
        if (answer == SINGULAR && icntl[COUNT_FIRST] && *used > 0 && told.negative >= *used) {
            info[NEGATIVE] = told.negative;
            *maxfrt = stride_of(told.largest);
            return;
        }
    }
    if (answer == SHORT_INTEGERS || answer == SHORT_REALS) {
        /* Both arrays will be others then. */
        if (ikeep[STATE] == PLANNED) ikeep[STATE] = *n > 1 ? ORDERED : UNKNOWN;
        if ((answer == SHORT_INTEGERS ? *liw : *la) == INT_MAX) answer = TOO_LARGE;
    }
    info[FLAG] = answer;
    if (answer == SHORT_INTEGERS || answer == SHORT_REALS) info[DETAIL] = clipped(wanted);
    if (answer == DONE) {
        *maxfrt = stride_of(told.largest); /* the room that solving needs */
        info[BLOCKS] = told.blocks;
        info[NEGATIVE] = told.negative;
        info[REALS] = clipped((int64_t)told.entries);
        if (told.operations > DEAR * p.expected.operations && told.delayed > 0 && ikeep[GIVEN_UP] < PATIENCE &&
            *n > TINY) {
            ikeep[GIVEN_UP]++; /* the next factorisation orders anew, by the values that it meets */
            ikeep[STATE] = TOO_DEAR;
            memcpy(place_of_cost(ikeep, *n), &told.operations, sizeof told.operations);
        }
    }
}

PUBLIC void ma27cd_(const int *n, const double *a, const int *la, int *iw, const int *liw, double *w,
                    const int *maxfrt, double *rhs, int *iw1, const int *nsteps, const int *icntl, const double *cntl)
{
    (void)n, (void)la, (void)liw, (void)maxfrt, (void)iw1, (void)nsteps, (void)icntl, (void)cntl;
    plan p;
    view_plan(iw, &p);
    keep_negative(iw, p.negative, p.negative + 1);
    solve(p.fronts, iw + plan_length(&p), a, rhs, w);
}

/* Entries of the factor, multiplications of a factorisation, and rows of the largest front, in found[0 .. 2], as far as
 * they are known before pivots are delayed. Returns 0 when they could be found. */
PUBLIC int pyrobocop_factor_size(int n, int nz, const int *irn, const int *icn, const double *a, double *found)
{
    plan made;
    int *order = malloc(sizeof(int) * ((size_t)n + 1));
    enum outcome answer = order == NULL ? OUT_OF_MEMORY : DONE;
    made.first = NULL;
    if (answer == DONE) answer = plan_anew(n, nz, irn, icn, a, 1, order, &made);
    if (answer == DONE) {
        found[0] = made.expected.entries;
        found[1] = made.expected.operations;
        found[2] = made.largest;
        free_plan(&made);
    }
    free(order);
    return (int)answer;
}
