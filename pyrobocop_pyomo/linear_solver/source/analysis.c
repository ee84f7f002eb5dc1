/* From an order of elimination to a plan of dense fronts.
 *
 * Elimination tree: J. W. H. Liu, The role of elimination trees in sparse factorization, SIAM J. Matrix Anal. Appl. 11
 * (1990) 134-172, doi:10.1137/0611010. Fronts: I. S. Duff and J. K. Reid, The multifrontal solution of indefinite
 * sparse symmetric linear equations, ACM Trans. Math. Softw. 9 (1983) 302-325, doi:10.1145/356044.356047. Fronts that
 * differ little from their parent are merged with it: C. Ashcraft and R. Grimes, The influence of relaxed supernode
 * partitions on the multifrontal method, ACM Trans. Math. Softw. 15 (1989) 291-309, doi:10.1145/76909.76910.
 */
#include "symmetric_solver.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* -------------------------------------------------------------------------------------------------- graphs */

void free_graph(graph *g)
{
    free(g->start);
    free(g->neighbour);
    g->start = g->neighbour = NULL;
}

static int inside(int n, int i, int j) { return i >= 1 && i <= n && j >= 1 && j <= n; }

enum outcome matrix_graph(int n, int nz, const int *row, const int *column, const double *value, graph *g,
                          double **magnitude, double **diagonal)
{
    int64_t entries = 0;
    for (int k = 0; k < nz; k++)
        if (inside(n, row[k], column[k]) && row[k] != column[k]) entries += 2;
    if (entries > INT32_MAX) return TOO_LARGE;
    const int valued = magnitude != NULL;
    g->nodes = n;
    g->start = calloc((size_t)n + 2, sizeof(int));
    g->neighbour = malloc(sizeof(int) * ((size_t)entries + 1));
    int *seen = malloc(sizeof(int) * ((size_t)n + 1));
    double *sums = valued ? malloc(sizeof(double) * ((size_t)entries + 1)) : NULL;
    double *own = valued ? calloc((size_t)n + 1, sizeof(double)) : NULL;
    if (g->start == NULL || g->neighbour == NULL || seen == NULL || (valued && (sums == NULL || own == NULL))) {
        free_graph(g);
        free(seen);
        free(sums);
        free(own);
        return OUT_OF_MEMORY;
    }
    int *start = g->start;
    for (int k = 0; k < nz; k++)
        if (inside(n, row[k], column[k]) && row[k] != column[k]) {
            start[row[k]]++; /* row i is counted from 1: its number lies where the next one begins */
            start[column[k]]++;
        }
    for (int i = 0; i < n; i++) start[i + 1] += start[i];
    memcpy(seen, start, sizeof(int) * (size_t)n); /* where the next neighbour of a row is written */
    for (int k = 0; k < nz; k++) {
        const int i = row[k] - 1, j = column[k] - 1;
        if (!inside(n, row[k], column[k])) continue;
        if (i == j) {
            if (valued) own[i] += value[k];
            continue;
        }
        if (valued) sums[seen[i]] = sums[seen[j]] = value[k];
        g->neighbour[seen[i]++] = j;
        g->neighbour[seen[j]++] = i;
    }
    /* entries that stand several times become one */
    int to = 0;
    for (int i = 0; i < n; i++) seen[i] = -1;
    for (int i = 0, from = 0; i < n; i++) {
        const int begin = to;
        for (const int end = start[i + 1]; from < end; from++) {
            const int j = g->neighbour[from];
            if (seen[j] >= begin) {
                if (valued) sums[seen[j]] += sums[from];
                continue;
            }
            seen[j] = to;
            if (valued) sums[to] = sums[from];
            g->neighbour[to++] = j;
        }
        start[i] = begin;
    }
    free(seen);
    if (valued) {
        for (int k = 0; k < to; k++) sums[k] = fabs(sums[k]);
        for (int i = 0; i < n; i++) own[i] = fabs(own[i]);
        *magnitude = sums;
        *diagonal = own;
    }
    start[n] = to;
    return DONE;
}

/* ---------------------------------------------------------------------------------------- elimination tree */

enum outcome elimination_tree(const graph *g, const int *order, const int *position, int *parent, int *count,
                              expense *sum)
{
    const int n = g->nodes;
    int *ancestor = malloc(sizeof(int) * ((size_t)n + 1));
    if (ancestor == NULL) return OUT_OF_MEMORY;
    for (int k = 0; k < n; k++) { /* with paths that are shortened whenever they are walked */
        parent[k] = ancestor[k] = -1;
        for (int m = g->start[order[k]]; m < g->start[order[k] + 1]; m++) {
            int i = position[g->neighbour[m]];
            while (i >= 0 && i < k) {
                const int above = ancestor[i];
                ancestor[i] = k;
                if (above < 0) parent[i] = k;
                i = above;
            }
        }
    }
    int *mark = ancestor;
    for (int k = 0; k < n; k++) { /* row k of the factor is a subtree, walked from its leaves */
        mark[k] = k;
        count[k] = 1;
        for (int m = g->start[order[k]]; m < g->start[order[k] + 1]; m++)
            for (int i = position[g->neighbour[m]]; i < k && mark[i] != k; i = parent[i]) {
                mark[i] = k;
                count[i]++;
            }
    }
    sum->entries = sum->operations = 0.0;
    for (int k = 0; k < n; k++) {
        sum->entries += count[k];
        sum->operations += 0.5 * (double)count[k] * (double)count[k];
    }
    free(ancestor);
    return DONE;
}

/* Lists of the children of a forest's nodes, in their order: child[i] is the first of node i, sibling[j] the next. */
static void list_children(int n, const int *parent, int *child, int *sibling)
{
    for (int i = 0; i < n; i++) child[i] = -1;
    for (int i = n - 1; i >= 0; i--)
        if (parent[i] >= 0) {
            sibling[i] = child[parent[i]];
            child[parent[i]] = i;
        }
}

/* Children before parents, subtree by subtree: walked[k] is the k-th node. A forest given by parents that come after
 * their children. */
static enum outcome postorder(int n, const int *parent, int *walked)
{
    int *memory = malloc(sizeof(int) * (3 * (size_t)n + 1));
    if (memory == NULL) return OUT_OF_MEMORY;
    int *child = memory, *sibling = memory + n, *stack = memory + 2 * (size_t)n, done = 0;
    list_children(n, parent, child, sibling);
    for (int root = 0; root < n; root++) {
        if (parent[root] >= 0) continue;
        int top = 0;
        stack[top++] = root;
        while (top > 0) {
            const int i = stack[top - 1];
            if (child[i] >= 0) {
                stack[top++] = child[i];
                child[i] = sibling[child[i]];
            } else {
                walked[done++] = i;
                top--;
            }
        }
    }
    free(memory);
    return DONE;
}

/* -------------------------------------------------------------------------------------------------- fronts */

/* Entries of a front's part of the factor: `columns` of a triangle with `rows`. */
static double trapezoid(double columns, double rows) { return columns * rows - 0.5 * columns * (columns - 1.0); }

/* Zeros that a merged front may hold among its entries. Small fronts cost more in being handled than in zeros. */
static int worth_merging(double columns, double rows, double nonzero)
{
    const double zeros = trapezoid(columns, rows) - nonzero, all = trapezoid(columns, rows);
    const double part = columns <= 8 ? 0.6 : columns <= 16 ? 0.25 : columns <= 48 ? 0.1 : 0.0;
    return zeros <= part * all;
}

/* Columns with the same rows below become one front; then fronts are merged with their parents. `member[k]` is the
 * front of column k, `above[f]` the parent of front f, `columns[f]` and `size[f]` are its columns and rows. Fronts that
 * were merged have member == the front that took them up. Returns their number before merging. */
static int gather_columns(int n, const int *parent, const int *count, const char *tied, int *member, int *above,
                          int *columns, int *size, double *nonzero)
{
    int fronts = 0;
    for (int k = 0; k < n; k++) {
        const int joined = k > 0 && parent[k - 1] == k && (count[k - 1] == count[k] + 1 || tied[k - 1]);
        if (!joined) {
            columns[fronts] = 0;
            nonzero[fronts] = 0.0;
            fronts++;
        }
        member[k] = fronts - 1;
        columns[fronts - 1]++;
        nonzero[fronts - 1] += count[k];
        size[fronts - 1] = columns[fronts - 1] + count[k] - 1;
    }
    for (int k = 0; k < n; k++) above[member[k]] = parent[k] < 0 ? -1 : member[parent[k]];
    return fronts;
}

static int taken_by(int *into, int f)
{
    while (into[f] != f) f = into[f] = into[into[f]];
    return f;
}

static void merge_fronts(int fronts, const int *above, const char *forced, int *columns, int *size, double *nonzero,
                         int *into, int *child, int *sibling)
{
    for (int f = 0; f < fronts; f++) {
        into[f] = f;
        child[f] = -1;
    }
    for (int f = 0; f < fronts; f++) {
        for (int c = child[f]; c >= 0; c = sibling[c]) { /* complete, since children come first */
            const double together = (double)columns[c] + columns[f];
            const double rows = (double)columns[c] + size[f];
            if (!forced[c] && !worth_merging(together, rows, nonzero[c] + nonzero[f])) continue;
            into[c] = f;
            columns[f] += columns[c];
            size[f] += columns[c];
            nonzero[f] += nonzero[c];
        }
        if (above[f] >= 0) {
            sibling[f] = child[above[f]];
            child[above[f]] = f;
        }
    }
}

/* ---------------------------------------------------------------------------------------------------- plan */

void free_plan(plan *made)
{
    free(made->first);
    made->first = NULL;
}

/* What is stored of a plan: itself, and then its integer arrays in this order. */
enum { HEADER = sizeof(plan) / sizeof(int), AT_NEGATIVE = offsetof(plan, negative) / sizeof(int) };

static void lay_out(plan *p, int *at)
{
    p->first = at;
    p->rows_start = p->first + p->fronts + 1;
    p->entry_start = p->rows_start + p->fronts + 1;
    p->children = p->entry_start + p->fronts + 1;
    p->order = p->children + p->fronts;
    p->rows = p->order + p->n;
    p->place = p->rows + p->below;
    p->entry = p->place + p->below;
    p->target = p->entry + p->taken;
}

static int64_t array_length(const plan *p)
{
    return 4 * (int64_t)p->fronts + 3 + p->n + 2 * (int64_t)p->below + 2 * (int64_t)p->taken;
}

int64_t plan_length(const plan *made) { return HEADER + array_length(made); }

int copy_plan(const plan *made, plan *copied)
{
    const size_t length = sizeof(int) * (size_t)array_length(made);
    int *arrays = malloc(length);
    if (arrays == NULL) return 0;
    memcpy(arrays, made->first, length);
    *copied = *made;
    lay_out(copied, arrays);
    return 1;
}

void store_plan(const plan *made, int *integers)
{
    memcpy(integers, made, sizeof *made);
    memcpy(integers + HEADER, made->first, sizeof(int) * (size_t)array_length(made));
}

void keep_negative(int *integers, int negative, int used)
{
    integers[AT_NEGATIVE] = negative;
    integers[AT_NEGATIVE + 1] = used;
}

void view_plan(int *integers, plan *seen)
{
    memcpy(seen, integers, sizeof *seen);
    lay_out(seen, integers + HEADER);
}

/* Lengths that the factorisation needs: fronts, factor and what children hand to parents live in one array. */
static enum outcome foresee_lengths(plan *p, const int *above)
{
    double factor = 0.0, handed = 0.0, peak = 0.0;
    double integers = 0.0, held = 0.0, most_held = 0.0, operations = 0.0;
    double *block = malloc(sizeof(double) * ((size_t)p->fronts + 1)); /* what the children of a front hand to it */
    if (block == NULL) return OUT_OF_MEMORY;
    for (int f = 0; f < p->fronts; f++) block[f] = 0.0;
    p->largest = 0;
    for (int f = 0; f < p->fronts; f++) {
        const double columns = p->first[f + 1] - p->first[f], below = p->rows_start[f + 1] - p->rows_start[f];
        const double size = columns + below, stride = stride_of((int)size);
        if (size > p->largest) p->largest = (int)size;
        if (factor + (size + 1.0) * stride + handed > peak) peak = factor + (size + 1.0) * stride + handed;
        factor += stride * columns;
        handed -= block[f];
        held -= 3.0 * p->children[f];
        if (above[f] >= 0) {
            block[above[f]] += 0.5 * below * (below + 1.0);
            handed += 0.5 * below * (below + 1.0);
            held += 3.0;
        }
        if (factor + handed > peak) peak = factor + handed;
        if (held > most_held) most_held = held;
        integers += size + 4.0;
        operations += 0.5 * columns * size * size;
    }
    free(block);
    if (peak > INT32_MAX / 2.0 || integers + most_held > INT32_MAX / 2.0) return TOO_LARGE;
    p->reals = (int)peak;
    p->expected.operations = operations; /* with the zeros that merged fronts hold */
    p->expected.entries = factor;
    p->integers = (int)(integers + most_held) + 2 * p->largest + 16; /* a front is listed twice while it is made */
    return DONE;
}

/* Rows below the columns of each front, in order of elimination: row k is asked which fronts it reaches. */
static void fill_rows(const graph *g, plan *p, const int *position, const int *front_of, const int *above, int *mark,
                      int *fill)
{
    for (int f = 0; f < p->fronts; f++) {
        mark[f] = -1;
        fill[f] = p->rows_start[f];
    }
    for (int k = 0; k < p->n; k++) {
        const int i = p->order[k];
        mark[front_of[k]] = k;
        for (int m = g->start[i]; m < g->start[i + 1]; m++) {
            const int j = position[g->neighbour[m]];
            if (j > k) continue;
            for (int f = front_of[j]; mark[f] != k; f = above[f]) {
                mark[f] = k;
                p->rows[fill[f]++] = i;
            }
        }
    }
}

/* Places of rows in the parent's front, and of the matrix's entries in their front. */
static void find_places(plan *p, const int *row, const int *column, const int *position, const int *front_of,
                        const int *above, int *where, int *child, int *sibling)
{
    int *fill = child;
    for (int f = 0; f < p->fronts; f++) fill[f] = p->entry_start[f];
    for (int k = 0; k < p->nz; k++) {
        if (!inside(p->n, row[k], column[k])) continue;
        const int i = position[row[k] - 1], j = position[column[k] - 1];
        p->entry[fill[front_of[i < j ? i : j]]++] = k;
    }
    list_children(p->fronts, above, child, sibling);
    for (int f = 0; f < p->fronts; f++) {
        const int first = p->first[f], columns = p->first[f + 1] - first;
        const int stride = stride_of(columns + p->rows_start[f + 1] - p->rows_start[f]);
        for (int k = 0; k < columns; k++) where[p->order[first + k]] = k;
        for (int k = p->rows_start[f]; k < p->rows_start[f + 1]; k++)
            where[p->rows[k]] = columns + k - p->rows_start[f];
        for (int c = child[f]; c >= 0; c = sibling[c])
            for (int k = p->rows_start[c]; k < p->rows_start[c + 1]; k++) p->place[k] = where[p->rows[k]];
        for (int k = p->entry_start[f]; k < p->entry_start[f + 1]; k++) {
            const int a = where[row[p->entry[k]] - 1], b = where[column[p->entry[k]] - 1];
            p->target[k] = (a < b ? a : b) * stride + (a < b ? b : a);
        }
    }
}

enum outcome make_plan(int n, int nz, const int *row, const int *column, const int *order, plan *made)
{
    graph g = {0, NULL, NULL};
    const size_t rows = (size_t)n + 1;
    made->first = NULL;
    enum outcome answer = matrix_graph(n, nz, row, column, NULL, &g, NULL, NULL);
    if (answer != DONE) return answer;
    int *memory = malloc(sizeof(int) * 14 * rows);
    double *nonzero = malloc(sizeof(double) * rows);
    char *together = malloc(2 * rows);
    if (memory == NULL || nonzero == NULL || together == NULL) {
        answer = OUT_OF_MEMORY;
        goto end;
    }
    int *position = memory, *parent = position + rows, *count = parent + rows, *walked = count + rows;
    int *sorted = walked + rows, *member = sorted + rows, *above = member + rows, *columns = above + rows;
    int *size = columns + rows, *into = size + rows, *child = into + rows, *sibling = child + rows;
    int *number = sibling + rows, *plain = number + rows;
    char *forced = together + rows;
    expense sum;

    /* the order given, then the same with every subtree in one piece */
    for (int k = 0; k < n; k++) plain[k] = order[k] < 0 ? ~order[k] : order[k];
    for (int k = 0; k < n; k++) position[plain[k]] = k;
    answer = elimination_tree(&g, plain, position, parent, count, &sum);
    if (answer == DONE) answer = postorder(n, parent, walked);
    if (answer != DONE) goto end;
    for (int k = 0; k < n; k++) number[walked[k]] = k;
    for (int k = 0; k < n; k++) {
        sorted[k] = plain[walked[k]];
        into[k] = parent[walked[k]] < 0 ? -1 : number[parent[walked[k]]];
        child[k] = count[walked[k]];
        /* the partner of a tied row is its parent, unless they share no entry any more */
        together[k] = order[walked[k]] < 0 && parent[walked[k]] == walked[k] + 1;
    }
    memcpy(parent, into, sizeof(int) * (size_t)n);
    memcpy(count, child, sizeof(int) * (size_t)n);

    const int before = gather_columns(n, parent, count, together, member, above, columns, size, nonzero);
    for (int f = 0; f < before; f++) forced[f] = 0;
    for (int k = 0; k < n; k++)
        if (together[k] && member[parent[k]] != member[k]) forced[member[k]] = 1;
    merge_fronts(before, above, forced, columns, size, nonzero, into, child, sibling);

    /* the fronts that are left, subtree by subtree */
    int fronts = 0;
    for (int f = 0; f < before; f++)
        if (into[f] == f) number[f] = fronts++;
    for (int f = 0; f < before; f++)
        if (into[f] == f) {
            child[number[f]] = above[f] < 0 ? -1 : number[taken_by(into, above[f])];
            walked[number[f]] = f;
        }
    memcpy(above, child, sizeof(int) * (size_t)fronts);
    answer = postorder(fronts, above, sibling);
    if (answer != DONE) goto end;
    for (int k = 0; k < fronts; k++) parent[sibling[k]] = k;       /* new number of a front */
    for (int k = 0; k < fronts; k++) child[k] = above[sibling[k]] < 0 ? -1 : parent[above[sibling[k]]];
    memcpy(above, child, sizeof(int) * (size_t)fronts);

    made->n = n;
    made->nz = nz;
    made->fronts = fronts;
    made->negative = made->used = 0;
    int64_t below = 0, taken = 0;
    for (int k = 0; k < fronts; k++) below += size[walked[sibling[k]]] - columns[walked[sibling[k]]];
    for (int k = 0; k < nz; k++) taken += inside(n, row[k], column[k]);
    for (int k = 0; k < fronts; k++)
        if (size[walked[sibling[k]]] > 46336) answer = TOO_LARGE; /* whose square is no int any more */
    if (below > INT32_MAX / 4) answer = TOO_LARGE;
    if (answer != DONE) goto end;
    made->below = (int)below;
    made->taken = (int)taken;
    int *arrays = malloc(sizeof(int) * (size_t)array_length(made));
    if (arrays == NULL) {
        answer = OUT_OF_MEMORY;
        goto end;
    }
    lay_out(made, arrays);
    made->first[0] = made->rows_start[0] = 0;
    for (int k = 0; k < fronts; k++) {
        const int f = walked[sibling[k]];
        made->first[k + 1] = made->first[k] + columns[f];
        made->rows_start[k + 1] = made->rows_start[k] + size[f] - columns[f];
        made->children[k] = 0;
        count[k] = made->first[k];
    }
    for (int k = 0; k < fronts; k++)
        if (above[k] >= 0) made->children[above[k]]++;
    int *front_of = columns; /* from here on, of positions in the new order */
    for (int k = 0; k < n; k++) { /* columns of merged fronts keep their order, in which children come first */
        const int f = parent[number[taken_by(into, member[k])]];
        made->order[count[f]++] = sorted[k];
    }
    for (int f = 0; f < fronts; f++)
        for (int k = made->first[f]; k < made->first[f + 1]; k++) front_of[k] = f;
    for (int k = 0; k < n; k++) position[made->order[k]] = k;
    for (int f = 0; f <= fronts; f++) made->entry_start[f] = 0;
    for (int k = 0; k < nz; k++) {
        if (!inside(n, row[k], column[k])) continue;
        const int i = position[row[k] - 1], j = position[column[k] - 1];
        made->entry_start[front_of[i < j ? i : j] + 1]++;
    }
    for (int f = 0; f < fronts; f++) made->entry_start[f + 1] += made->entry_start[f];
    fill_rows(&g, made, position, front_of, above, sibling, child);
    find_places(made, row, column, position, front_of, above, size, child, sibling);
    answer = foresee_lengths(made, above);
    if (answer != DONE) free_plan(made);
end:
    free(memory);
    free(nonzero);
    free(together);
    free_graph(&g);
    return answer;
}
