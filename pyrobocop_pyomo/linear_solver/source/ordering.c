/* Order of elimination.
 *
 * Approximate minimum degree on the quotient graph: P. R. Amestoy, T. A. Davis and I. S. Duff, An approximate minimum
 * degree ordering algorithm, SIAM J. Matrix Anal. Appl. 17 (1996) 886-905, doi:10.1137/S0895479894278952.
 * Rows without a diagonal entry are tied to a neighbour before: I. S. Duff and S. Pralet, Strategies for scaling and
 * pivoting for sparse symmetric indefinite problems, SIAM J. Matrix Anal. Appl. 27 (2005) 313-340,
 * doi:10.1137/04061043X.
 */
#include "symmetric_solver.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ------------------------------------------------------------------------------------------ minimum degree */

/* A node of the quotient graph is a variable (not yet eliminated; it may stand for several that cannot be told apart),
 * an element (eliminated; its list holds the variables that it couples), or gone. The list of a variable holds its
 * elements first and then the variables that it is still coupled with directly. */
enum kind { VARIABLE, ELEMENT, GONE };

typedef struct {
    int n;
    int *start, *length, *elements; /* of the lists, and how many elements a variable's list begins with */
    int *size;                      /* rows that a node stands for; negative while it is in the new element */
    int *degree;                    /* of a variable: bound on its degree; of an element: rows that it couples */
    int *head, *next, *previous;    /* lists of variables with the same degree; `head` and `next` also for hashing */
    int *outside;                   /* of an element: stamp + rows outside of the new element */
    int *follower, *last;           /* chains of variables that are eliminated together */
    char *kind;
    int *list;                      /* all lists, one after another */
    int64_t capacity, used;
} quotient;

static void unlink_degree(quotient *q, int i)
{
    const int after = q->next[i], before = q->previous[i];
    if (after >= 0) q->previous[after] = before;
    if (before >= 0) q->next[before] = after;
    else q->head[q->degree[i]] = after;
}

static void link_degree(quotient *q, int i)
{
    const int first = q->head[q->degree[i]];
    q->next[i] = first;
    q->previous[i] = -1;
    if (first >= 0) q->previous[first] = i;
    q->head[q->degree[i]] = i;
}

/* j is eliminated together with i. */
static void chain(quotient *q, int i, int j)
{
    q->follower[q->last[i]] = j;
    q->last[i] = q->last[j];
}

/* Move the lists to the beginning of their array. The first entry of each list is exchanged for a mark of its owner
 * while they are moved, so that no list of lists is needed. */
static void compact(quotient *q)
{
    int64_t from, to = 0;
    for (int i = 0; i < q->n; i++)
        if (q->kind[i] != GONE && q->length[i] > 0) {
            const int begin = q->start[i];
            q->start[i] = q->list[begin];
            q->list[begin] = -1 - i;
        }
    for (from = 0; from < q->used;) {
        const int mark = q->list[from++];
        if (mark >= 0) continue;
        const int i = -1 - mark;
        q->list[to] = q->start[i];
        q->start[i] = (int)to++;
        for (int k = 1; k < q->length[i]; k++) q->list[to++] = q->list[from++];
    }
    q->used = to;
}

/* Variables coupled by the elimination of p; they lose their place in the degree lists and their size turns negative.
 * Elements of p are absorbed. Returns the number of rows. */
static int form_element(quotient *q, int p)
{
    int64_t bound = q->length[p];
    for (int k = 0; k < q->elements[p]; k++) bound += q->length[q->list[q->start[p] + k]];
    if (bound > q->n) bound = q->n;
    if (q->used + bound > q->capacity) compact(q);
    const int begin = (int)q->used, own = q->start[p];
    int rows = 0;
    q->size[p] = -q->size[p]; /* not a member of its own element */
    for (int k = 0; k <= q->elements[p]; k++) {
        /* each element of p, and at last what it is coupled with directly */
        int from, count;
        if (k < q->elements[p]) {
            const int e = q->list[own + k];
            from = q->start[e];
            count = q->length[e];
            q->kind[e] = GONE;
        } else {
            from = own + q->elements[p];
            count = q->length[p] - q->elements[p];
        }
        for (int m = from; m < from + count; m++) {
            const int i = q->list[m];
            if (q->size[i] <= 0) continue;
            rows += q->size[i];
            q->size[i] = -q->size[i];
            unlink_degree(q, i);
            q->list[q->used++] = i;
        }
    }
    q->size[p] = -q->size[p];
    q->kind[p] = ELEMENT;
    q->start[p] = begin;
    q->length[p] = (int)q->used - begin;
    q->elements[p] = 0;
    return rows;
}

/* For every element that touches the new one: its rows outside of that, as outside[e] - stamp. */
static void count_outside(quotient *q, int p, int stamp)
{
    for (int k = q->start[p]; k < q->start[p] + q->length[p]; k++) {
        const int i = q->list[k], rows = -q->size[i];
        for (int m = q->start[i]; m < q->start[i] + q->elements[i]; m++) {
            const int e = q->list[m];
            if (q->kind[e] != ELEMENT) continue;
            if (q->outside[e] < stamp) q->outside[e] = q->degree[e] + stamp;
            q->outside[e] -= rows;
        }
    }
}

/* Shorten the list of variable i of the new element p, and bound its degree without p. Returns the hash of the list;
 * -1 if nothing but p is left in it. */
static int64_t prune(quotient *q, int i, int p, int stamp)
{
    const int begin = q->start[i], middle = begin + q->elements[i], end = begin + q->length[i];
    int to = begin;
    int64_t degree = 0, hash = 0;
    for (int k = begin; k < middle; k++) {
        const int e = q->list[k];
        if (q->kind[e] != ELEMENT) continue;
        const int outside = q->outside[e] - stamp;
        if (outside == 0) {
            q->kind[e] = GONE; /* it couples nothing that p does not couple */
            continue;
        }
        degree += outside;
        hash += e;
        q->list[to++] = e;
    }
    /* There is room for p: i lost either an element that p absorbed or the variable p itself. */
    const int elements_end = to;
    int held = -1, kept = 0;
    int write = to + 1;
    for (int k = middle; k < end; k++) {
        const int j = q->list[k];
        if (q->kind[j] != VARIABLE || q->size[j] <= 0) continue;
        degree += q->size[j];
        hash += j;
        kept++;
        /* `write` may be one ahead of `k` at most, and then for one entry only */
        if (write > k) held = j;
        else q->list[write++] = j;
    }
    if (held >= 0) q->list[write++] = held;
    q->list[elements_end] = p;
    q->elements[i] = elements_end - begin + 1;
    q->length[i] = q->elements[i] + kept;
    if (q->elements[i] == 1 && kept == 0) return -1;
    if (degree < q->degree[i]) q->degree[i] = (int)degree;
    return (hash + p) % q->n;
}

/* Variables of the new element with the same list become one. Buckets are chained by `next`; `bucket[h]` starts one. */
static void merge_alike(quotient *q, int p, const int *hash, int *bucket, int *seen, int *stamp)
{
    for (int k = q->start[p]; k < q->start[p] + q->length[p]; k++) {
        const int leader = q->list[k];
        if (q->kind[leader] != VARIABLE) continue;
        int i = bucket[hash[leader]];
        bucket[hash[leader]] = -1; /* each bucket is dealt with once */
        for (; i >= 0; i = q->next[i]) {
            if (q->kind[i] != VARIABLE || q->next[i] < 0) continue;
            ++*stamp;
            for (int m = q->start[i]; m < q->start[i] + q->length[i]; m++) seen[q->list[m]] = *stamp;
            int before = i;
            for (int j = q->next[i]; j >= 0; j = q->next[j]) {
                int alike = q->length[j] == q->length[i] && q->elements[j] == q->elements[i];
                for (int m = q->start[j]; alike && m < q->start[j] + q->length[j]; m++)
                    alike = seen[q->list[m]] == *stamp;
                if (alike) {
                    q->size[i] += q->size[j]; /* both are negative here */
                    q->size[j] = 0;
                    q->kind[j] = GONE;
                    chain(q, i, j);
                    q->next[before] = q->next[j];
                } else before = j;
            }
        }
    }
}

/* Returns how many nodes were written to order. */
static int eliminate_all(quotient *q, int total, int *hash, int *bucket, int *seen, int *order)
{
    int least = 0, done = 0, written = 0, stamp = 1, seen_stamp = 0;
    while (done < total) {
        while (q->head[least] < 0) least++;
        const int p = q->head[least];
        unlink_degree(q, p);
        done += q->size[p];
        int rows = form_element(q, p);
        q->degree[p] = rows;
        if (stamp > INT32_MAX - 2 * total - 2) {
            for (int i = 0; i < q->n; i++) q->outside[i] = 0;
            stamp = 1;
        }
        count_outside(q, p, stamp);
        for (int k = q->start[p]; k < q->start[p] + q->length[p]; k++) {
            const int i = q->list[k];
            const int64_t key = prune(q, i, p, stamp);
            if (key < 0) { /* i couples nothing but p does: it may follow at once */
                rows += q->size[i];
                done -= q->size[i];
                q->size[i] = 0;
                q->kind[i] = GONE;
                chain(q, p, i);
                continue;
            }
            hash[i] = (int)key;
            q->next[i] = bucket[hash[i]];
            bucket[hash[i]] = i;
        }
        q->degree[p] = rows;
        stamp += total + 1; /* above every mark of this round */
        merge_alike(q, p, hash, bucket, seen, &seen_stamp);
        int to = q->start[p];
        for (int k = q->start[p], end = k + q->length[p]; k < end; k++) {
            const int i = q->list[k];
            if (q->kind[i] != VARIABLE) continue;
            q->size[i] = -q->size[i];
            int64_t degree = (int64_t)q->degree[i] + rows - q->size[i];
            if (degree > total - done - q->size[i]) degree = total - done - q->size[i];
            q->degree[i] = (int)degree;
            link_degree(q, i);
            if (q->degree[i] < least) least = q->degree[i];
            q->list[to++] = i;
        }
        q->length[p] = to - q->start[p];
        if (q->length[p] == 0) q->kind[p] = GONE;
        q->used = to;
        for (int i = p; i >= 0; i = q->follower[i]) order[written++] = i;
    }
    return written;
}

enum outcome order_by_degree(const graph *g, const int *weight, int *order)
{
    const int n = g->nodes;
    if (n == 0) return DONE;
    int64_t total = 0;
    for (int i = 0; i < n; i++) total += weight[i];
    const int64_t entries = g->start[n], capacity = entries + entries / 5 + 2 * (int64_t)n + 1;
    if (capacity > INT32_MAX || total > INT32_MAX / 4) return TOO_LARGE;
    int *memory = malloc(sizeof(int) * ((size_t)13 * (size_t)n + (size_t)total + 1 + (size_t)capacity));
    char *kind = malloc((size_t)n);
    if (memory == NULL || kind == NULL) {
        free(memory);
        free(kind);
        return OUT_OF_MEMORY;
    }
    quotient q;
    int *at = memory;
    int **fields[] = {&q.start, &q.length, &q.elements, &q.size, &q.degree, &q.next, &q.previous,
                      &q.outside, &q.follower, &q.last};
    for (size_t k = 0; k < sizeof fields / sizeof *fields; k++, at += n) *fields[k] = at;
    int *hash = at, *bucket = at + n, *seen = at + 2 * (size_t)n;
    at += 3 * (size_t)n;
    q.head = at;
    at += total + 1;
    q.list = at;
    q.n = n;
    q.kind = kind;
    q.capacity = capacity;
    q.used = entries;
    memcpy(q.list, g->neighbour, sizeof(int) * (size_t)entries);
    for (int64_t k = 0; k <= total; k++) q.head[k] = -1;

    /* A row that couples with nearly all others would spoil every bound; it comes last whatever is done. */
    const double dense = fmax(16.0, 10.0 * sqrt((double)n));
    int sparse_total = 0;
    for (int i = 0; i < n; i++) {
        q.start[i] = g->start[i];
        q.length[i] = g->start[i + 1] - g->start[i];
        q.elements[i] = 0;
        q.outside[i] = 0;
        q.follower[i] = -1;
        q.last[i] = i;
        q.next[i] = q.previous[i] = -1;
        bucket[i] = -1;
        seen[i] = 0;
        q.kind[i] = q.length[i] > dense ? GONE : VARIABLE;
        q.size[i] = q.kind[i] == GONE ? 0 : weight[i];
        sparse_total += q.size[i];
    }
    for (int i = 0; i < n; i++) {
        if (q.kind[i] == GONE) continue;
        int64_t degree = 0;
        for (int k = q.start[i]; k < q.start[i] + q.length[i]; k++) degree += q.size[q.list[k]];
        q.degree[i] = (int)degree;
        link_degree(&q, i);
    }
    int written = eliminate_all(&q, sparse_total, hash, bucket, seen, order);
    for (int i = 0; i < n; i++)
        if (g->start[i + 1] - g->start[i] > dense) order[written++] = i;
    free(memory);
    free(kind);
    return DONE;
}

/* ----------------------------------------------------------------------------------------------- tied pairs */

enum { ALONE = -1 };

/* A diagonal entry below this part of its row is no pivot to count on. */
static const double WEAK_DIAGONAL = 1e-3;
/* A partner whose entry is below this part of the row is not taken. */
static const double WEAK_PARTNER = 1e-3;
/* Ties cost fill; without them pivots are delayed, which costs more. So an order without ties must be this much better. */
static const double CLEARLY_CHEAPER = 0.5;
/* With so few multiplications for each row, half of them would be lost in all that a factorisation does beside them. */
static const double CHEAP = 100.0;

/* Rows sorted by the number of their neighbours. */
static void sort_by_degree(const graph *g, int *sorted, int *bucket)
{
    const int n = g->nodes;
    for (int d = 0; d <= n; d++) bucket[d] = 0;
    for (int i = 0; i < n; i++) bucket[g->start[i + 1] - g->start[i] + 1]++;
    for (int d = 0; d < n; d++) bucket[d + 1] += bucket[d];
    for (int i = 0; i < n; i++) sorted[bucket[g->start[i + 1] - g->start[i]]++] = i;
}

/* What is known of a matrix when its rows are tied. */
typedef struct {
    const graph *g;
    const double *magnitude, *diagonal;
    double *largest; /* beside the diagonal, of each row */
    int *partner;
} ties;

/* More neighbours than that are not searched for somebody else's partner. */
enum { FEW = 64 };

static int is_weak(const ties *t, int i)
{
    return t->largest[i] > 0.0 && t->diagonal[i] <= WEAK_DIAGONAL * t->largest[i];
}

static void pair_up(ties *t, int i, int j)
{
    t->partner[i] = j;
    t->partner[j] = i;
}

/* The best neighbour of row i that has no partner: a large entry, few neighbours. */
static int free_neighbour(const ties *t, int i)
{
    double best = 0.0;
    int chosen = ALONE;
    for (int k = t->g->start[i]; k < t->g->start[i + 1]; k++) {
        const int j = t->g->neighbour[k];
        if (t->partner[j] != ALONE || t->magnitude[k] < WEAK_PARTNER * t->largest[i]) continue;
        const double merit = t->magnitude[k] / (double)(t->g->start[j + 1] - t->g->start[j]);
        if (merit > best) {
            best = merit;
            chosen = j;
        }
    }
    return chosen;
}

/* Row i is weak and all its neighbours have partners: one whose partner can do without it, or can find another. */
static void take_from_other(ties *t, int i)
{
    if (t->g->start[i + 1] - t->g->start[i] > FEW) return;
    for (int k = t->g->start[i]; k < t->g->start[i + 1]; k++) {
        const int j = t->g->neighbour[k], other = t->partner[j];
        if (t->magnitude[k] < WEAK_PARTNER * t->largest[i]) continue;
        if (other == ALONE || !is_weak(t, other)) {
            if (other != ALONE) t->partner[other] = ALONE;
            pair_up(t, i, j);
            return;
        }
        if (t->g->start[other + 1] - t->g->start[other] > FEW) continue;
        t->partner[i] = j; /* so that i itself is not found */
        const int instead = free_neighbour(t, other);
        t->partner[i] = ALONE;
        if (instead == ALONE) continue;
        pair_up(t, other, instead);
        pair_up(t, i, j);
        return;
    }
}

/* Partners of the rows with a weak diagonal. */
static void tie(ties *t, const int *sorted)
{
    const graph *g = t->g;
    for (int i = 0; i < g->nodes; i++) {
        t->partner[i] = ALONE;
        t->largest[i] = 0.0;
        for (int k = g->start[i]; k < g->start[i + 1]; k++)
            if (t->magnitude[k] > t->largest[i]) t->largest[i] = t->magnitude[k];
    }
    for (int s = 0; s < g->nodes; s++) {
        const int i = sorted[s];
        if (t->partner[i] != ALONE || !is_weak(t, i)) continue;
        const int chosen = free_neighbour(t, i);
        if (chosen == ALONE) continue;
        pair_up(t, i, chosen);
    }
    for (int s = 0; s < g->nodes; s++)
        if (t->partner[sorted[s]] == ALONE && is_weak(t, sorted[s])) take_from_other(t, sorted[s]);
}

/* The graph in which each pair is one node. `node[i]` is the node of row i, `leader` the first row of each node. */
static enum outcome compress(const graph *g, const int *partner, int *node, int *leader, int *weight, graph *small)
{
    const int n = g->nodes;
    int nodes = 0;
    for (int i = 0; i < n; i++) {
        if (partner[i] != ALONE && partner[i] < i) continue;
        node[i] = nodes;
        weight[nodes] = 1;
        if (partner[i] != ALONE) {
            node[partner[i]] = nodes;
            weight[nodes] = 2;
        }
        leader[nodes++] = i;
    }
    small->nodes = nodes;
    small->start = malloc(sizeof(int) * ((size_t)nodes + 1));
    small->neighbour = malloc(sizeof(int) * ((size_t)g->start[n] + 1));
    int *seen = malloc(sizeof(int) * ((size_t)nodes + 1));
    if (small->start == NULL || small->neighbour == NULL || seen == NULL) {
        free_graph(small);
        free(seen);
        return OUT_OF_MEMORY;
    }
    for (int v = 0; v < nodes; v++) seen[v] = -1;
    int used = 0;
    for (int v = 0; v < nodes; v++) {
        small->start[v] = used;
        seen[v] = v;
        for (int i = leader[v], second = 0; i != ALONE; i = second++ ? ALONE : partner[i])
            for (int k = g->start[i]; k < g->start[i + 1]; k++) {
                const int w = node[g->neighbour[k]];
                if (seen[w] == v) continue;
                seen[w] = v;
                small->neighbour[used++] = w;
            }
    }
    small->start[nodes] = used;
    free(seen);
    return DONE;
}

/* What an order costs in a matrix, without building anything. */
static enum outcome price(const graph *g, const int *order, int *memory, expense *sum)
{
    const int n = g->nodes;
    for (int k = 0; k < n; k++) memory[order[k]] = k;
    return elimination_tree(g, order, memory, memory + n, memory + 2 * (size_t)n, sum);
}

enum outcome tie_matrix(int n, int nz, const int *row, const int *column, const double *value, graph *g, int *partner)
{
    double *magnitude = NULL, *diagonal = NULL;
    const enum outcome answer = matrix_graph(n, nz, row, column, value, g, &magnitude, &diagonal);
    if (answer != DONE) return answer;
    int *memory = malloc(sizeof(int) * (2 * (size_t)n + 1));
    double *largest = malloc(sizeof(double) * ((size_t)n + 1));
    const int enough = memory != NULL && largest != NULL;
    if (enough) {
        sort_by_degree(g, memory, memory + n);
        ties t = {g, magnitude, diagonal, largest, partner};
        tie(&t, memory);
    } else
        free_graph(g);
    free(memory);
    free(largest);
    free(magnitude);
    free(diagonal);
    return enough ? DONE : OUT_OF_MEMORY;
}

enum outcome order_tied(const graph *g, const int *partner, int may_leave, int *order)
{
    const int n = g->nodes;
    graph small = {0, NULL, NULL};
    expense paired_sum, plain_sum;
    enum outcome answer = DONE;
    int *memory = calloc(8 * (size_t)n + 2, sizeof(int)), pairs = 0;
    if (memory == NULL) return OUT_OF_MEMORY;
    int *node = memory, *leader = node + n, *weight = leader + n, *plain = weight + n;
    int *scratch = plain + n; /* 3 n + 1, and one n at the end for the order of the nodes */
    int *nodes_order = scratch + 3 * (size_t)n + 1;
    for (int i = 0; i < n; i++) {
        weight[i] = 1;
        pairs += partner[i] != ALONE;
    }
    if (pairs == 0) {
        answer = order_by_degree(g, weight, order);
        goto end;
    }
    answer = compress(g, partner, node, leader, weight, &small);
    if (answer == DONE) answer = order_by_degree(&small, weight, nodes_order);
    if (answer != DONE) goto end;
    for (int v = 0, k = 0; v < small.nodes; v++) {
        const int i = leader[nodes_order[v]];
        order[k++] = i;
        if (partner[i] != ALONE) order[k++] = partner[i];
    }
    answer = price(g, order, scratch, &paired_sum);
    if (answer == DONE && may_leave && paired_sum.operations > CHEAP * n) {
        for (int i = 0; i < n; i++) weight[i] = 1;
        answer = order_by_degree(g, weight, plain);
        if (answer == DONE) answer = price(g, plain, scratch, &plain_sum);
        if (answer == DONE && plain_sum.operations < CLEARLY_CHEAPER * paired_sum.operations) {
            memcpy(order, plain, sizeof(int) * (size_t)n);
            goto end;
        }
    }
    for (int k = 0; k < n; k++)
        if (partner[order[k]] != ALONE) {
            order[k] = ~order[k];
            k++; /* its partner */
        }
end:
    free(memory);
    free_graph(&small);
    return answer;
}
