/* A direct solver for sparse symmetric indefinite matrices: A = P L D L' P', D with blocks of one and two rows.
 *
 * ordering.c        which row is eliminated when (minimum degree on a graph in which rows may be tied in pairs)
 * analysis.c        the tree of fronts that follows from the order, and where everything lies in them
 * kept_plans.c      the last plans, for further matrices with the same structure
 * factor.c          the numbers: one dense front after another, with threshold pivoting
 * solve.c           forward and backward substitution
 * scaling.c         factors for badly scaled matrices
 * ma27_interface.c  the four functions that Ipopt loads, and their arrays
 *
 * Nothing is allocated that outlives a call, but for the few plans in kept_plans.c: all that a factorisation needs later
 * lies in the caller's two arrays, an integer one that holds the plan and the rows of the fronts, and a real one that
 * holds the entries and the factor. So any number of factorisations may live in one process, in any thread.
 */
#ifndef SYMMETRIC_SOLVER_H
#define SYMMETRIC_SOLVER_H

#include <stddef.h>
#include <stdint.h>

/* What a function of the solver may answer: as MA27 says it in INFO(1), which knows nothing of the last two. */
enum outcome {
    DONE = 0,
    SHORT_INTEGERS = -3,  /* the caller's integer array is too short */
    SHORT_REALS = -4,     /* the caller's real array is too short */
    SINGULAR = -5,        /* a pivot is missing, or a number is not finite */
    OUT_OF_MEMORY = -20,  /* malloc gave nothing */
    TOO_LARGE = -21       /* more entries than an int can count */
};

/* Rows of a dense front are updated in steps of so many; its columns are stored at distances that are multiples of it. */
enum { STEP = 4 };
static inline int stride_of(int rows) { return (rows + STEP - 1) & ~(STEP - 1); }

/* An undirected graph without loops: the neighbours of i are neighbour[start[i]] ... neighbour[start[i + 1] - 1]. */
typedef struct {
    int nodes;
    int *start;
    int *neighbour;
} graph;

/* Order of elimination by approximate minimum degree. `weight` tells how many rows a node stands for. */
enum outcome order_by_degree(const graph *g, const int *weight, int *order);

/* Rows of a matrix that have no diagonal entry to be a pivot, and their partners: partner[i] is -1 for rows without one.
 * The graph is the caller's to free. */
enum outcome tie_matrix(int n, int nz, const int *row, const int *column, const double *value, graph *g, int *partner);

/* Order of all rows. order[k] is the row that comes k-th, or ~row where it and the next are partners, and are to lie in one
 * front. With `may_leave`, an order without such ties is taken where it is clearly cheaper. */
enum outcome order_tied(const graph *g, const int *partner, int may_leave, int *order);

/* Entries of the factor and multiplications that an order leads to. */
typedef struct {
    double entries;
    double operations;
} expense;

/* The graph of a matrix in coordinates with indices from 1, in which an entry may stand in either triangle and several
 * times. With `magnitude`, also the absolute sums of the entries, and those of the diagonal. */
enum outcome matrix_graph(int n, int nz, const int *row, const int *column, const double *value, graph *g,
                          double **magnitude, double **diagonal);
void free_graph(graph *g);

/* Elimination tree of a graph in an order, as positions; -1 at roots. */
enum outcome elimination_tree(const graph *g, const int *order, const int *position, int *parent, int *count,
                              expense *sum);

/* The plan: fronts in the order in which they are factored, children before parents, subtree by subtree.
 *
 * Front f eliminates the columns first[f] ... first[f + 1] - 1 of the order; below them it has the rows
 * rows[rows_start[f]] ... (as rows of the matrix, in order of elimination), which have the places place[...] in the
 * front of its parent. The entries of the matrix that it takes are entry[entry_start[f]] ..., and target[...] are their
 * places in the array of the front, of which only the lower triangle, stored by columns, is used. */
typedef struct {
    int n, nz, fronts;
    int below;          /* length of rows and place */
    int taken;          /* length of entry and target */
    int largest;        /* rows of the largest front */
    int reals;          /* entries of the real array that are used when no pivot is delayed, without those of A */
    int integers;       /* the same for the integer array, without the plan itself */
    int negative;       /* eigenvalues that the last factorisation found, */
    int used;           /* and one more than those of the last that was solved with, 0 if none was */
    int *first, *rows_start, *entry_start, *children;
    int *order, *rows, *place, *entry, *target;
    expense expected;
} plan;

/* Make the plan in memory of its own. */
enum outcome make_plan(int n, int nz, const int *row, const int *column, const int *order, plan *made);
void free_plan(plan *made);

/* The plan in an integer array. */
int64_t plan_length(const plan *made);
int copy_plan(const plan *made, plan *copied); /* 0 without memory */
void store_plan(const plan *made, int *integers);
void view_plan(int *integers, plan *seen);
void keep_negative(int *integers, int negative, int used); /* in the plan that is stored there */

/* What a plan follows from: two matrices for which all of it is the same have the same plan. */
typedef struct {
    int n, nz, may_leave;
    const int *row, *column, *partner;
} origin;

/* The order and the plan of a matrix that was met before, where they are kept. Returns 0 where not. The plan is a copy. */
int find_plan(const origin *from, int *order, plan *made);
void keep_plan(const origin *from, const int *order, const plan *made);

/* What a factorisation tells. */
typedef struct {
    int negative;         /* negative eigenvalues */
    int blocks;           /* pivots with two rows */
    int delayed;          /* columns that a front handed on to its parent */
    int missing;          /* pivots that were found nowhere: zero eigenvalues */
    int largest;          /* rows of the largest front */
    double entries;       /* of the factor */
    double operations;    /* multiplications */
    int64_t wanted;       /* length that the array would need, with SHORT_INTEGERS and SHORT_REALS */
} statistics;

/* Factor the matrix whose entries are reals[0] ... reals[nz - 1], which stay as they are. The rows of the fronts are
 * written to records, the factor behind the entries. A pivot of one row is taken when it is at least `threshold` times
 * the largest entry of its column, one of two rows when its inverse keeps the factor as small. A singular matrix is gone
 * through to its end, so that its negative eigenvalues are told as well. */
enum outcome factor(const plan *p, double *reals, int64_t real_length, int *records, int64_t record_length,
                    double threshold, statistics *told);

/* Solve with the factor, in place; `work` has room for the largest front. */
void solve(int fronts, const int *records, const double *reals, double *x, double *work);

#endif
