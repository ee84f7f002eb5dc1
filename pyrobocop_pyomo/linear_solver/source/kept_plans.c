/* The last plans of this process. The same program is solved again and again, by a receding horizon, by a continuation, in
 * a sequence of data; each time the structure arrives as if it were new, and to order it takes as long as some
 * factorisations.
 *
 * A plan follows from the structure and from which rows are tied, and both are compared entry by entry. So a matrix has
 * the plan that it would have without all this. One thread at a time looks or writes; another one that comes meanwhile does
 * without, so nobody ever waits, not even in a process that was forked at such a moment.
 */
#include "symmetric_solver.h"

#include <stdlib.h>
#include <string.h>

/* So many, of matrices with at most so many entries: 25 MB at most. */
enum { KEPT = 8, MOST_ENTRIES = 150000 };

typedef struct {
    origin from;
    int *memory; /* row, column, partner and order; NULL where nothing is kept */
    plan made;
    unsigned long used;
} kept;

static kept plans[KEPT];
static unsigned long uses;
static char busy;

static int enter(void) { return !__atomic_test_and_set(&busy, __ATOMIC_ACQUIRE); }

static void leave(void) { __atomic_clear(&busy, __ATOMIC_RELEASE); }

static int same(const int *a, const int *b, int count) { return memcmp(a, b, sizeof(int) * (size_t)count) == 0; }

static int is_of(const kept *k, const origin *from)
{
    return k->memory != NULL && k->from.n == from->n && k->from.nz == from->nz && k->from.may_leave == from->may_leave &&
           same(k->from.partner, from->partner, from->n) && same(k->from.row, from->row, from->nz) &&
           same(k->from.column, from->column, from->nz);
}

int find_plan(const origin *from, int *order, plan *made)
{
    int found = 0;
    if (from->nz > MOST_ENTRIES || from->n > MOST_ENTRIES || !enter()) return 0;
    for (kept *k = plans; k < plans + KEPT && !found; k++) {
        if (!is_of(k, from)) continue;
        found = copy_plan(&k->made, made);
        memcpy(order, k->memory + 2 * (size_t)from->nz + from->n, sizeof(int) * (size_t)from->n);
        k->used = ++uses;
    }
    leave();
    return found;
}

void keep_plan(const origin *from, const int *order, const plan *made)
{
    const size_t n = (size_t)from->n, nz = (size_t)from->nz;
    if (from->nz > MOST_ENTRIES || from->n > MOST_ENTRIES) return;
    kept anew = {*from, malloc(sizeof(int) * (2 * nz + 2 * n + 1)), {0}, 0};
    if (anew.memory == NULL || !copy_plan(made, &anew.made)) {
        free(anew.memory);
        return;
    }
    memcpy(anew.memory, from->row, sizeof(int) * nz);
    memcpy(anew.memory + nz, from->column, sizeof(int) * nz);
    memcpy(anew.memory + 2 * nz, from->partner, sizeof(int) * n);
    memcpy(anew.memory + 2 * nz + n, order, sizeof(int) * n);
    anew.from.row = anew.memory;
    anew.from.column = anew.memory + nz;
    anew.from.partner = anew.memory + 2 * nz;
    kept old = anew; /* what is given up in the end: the new one, if others are at it */
    if (enter()) {
        kept *oldest = plans;
        for (kept *k = plans; k < plans + KEPT; k++)
            if (k->used < oldest->used) oldest = k;
        old = *oldest;
        anew.used = ++uses;
        *oldest = anew;
        leave();
    }
    if (old.memory == NULL) return;
    free(old.memory);
    free_plan(&old.made);
}
