#include "isolation_sweep.h"

#define MOST_COLUMNS 4 /* of two faults */

/* Share of a column that is left beside others, below which they are the same. */
#define SAME AMB_C(1e-4)

/* l of some columns together; their sizes and variances where wanted. A column that is the same as
 * those before it explains nothing more. */
static amb_real explained(const amb_isolation *iso, const sweep *w, int count, const int column[],
                          amb_real size[], amb_real variance[])
{
  amb_real L[MOST_COLUMNS][MOST_COLUMNS]; /* unit lower triangle */
  amb_real D[MOST_COLUMNS];
  amb_real v[MOST_COLUMNS];
  amb_real sum = AMB_C(0.0);
  for (int i = 0; i < count; i++) {
    D[i] = entry(iso, w, column[i], column[i]);
    v[i] = w->g[column[i]];
    const amb_real own = SAME * D[i];
    for (int k = 0; k < i; k++) {
      amb_real m = entry(iso, w, column[i], column[k]);
      for (int l = 0; l < k; l++) {
        m -= L[i][l] * L[k][l] * D[l];
      }
      L[i][k] = (D[k] > AMB_C(0.0)) ? (m / D[k]) : AMB_C(0.0);
      D[i] -= L[i][k] * L[i][k] * D[k];
      v[i] -= L[i][k] * v[k];
    }
    D[i] = ((D[i] > own) && (D[i] > AMB_C(0.0))) ? D[i] : AMB_C(0.0);
    sum += (D[i] > AMB_C(0.0)) ? ((v[i] * v[i]) / D[i]) : AMB_C(0.0);
  }
  if ((size != NULL) && (variance != NULL)) {
    for (int i = count - 1; i >= 0; i--) {
      amb_real inverse[MOST_COLUMNS]; /* row i of L' to the minus one */
      amb_clear(MOST_COLUMNS, inverse);
      size[i] = (D[i] > AMB_C(0.0)) ? (v[i] / D[i]) : AMB_C(0.0);
      variance[i] = AMB_C(0.0);
      for (int l = i + 1; l < count; l++) {
        size[i] -= L[l][i] * size[l];
      }
      inverse[i] = AMB_C(1.0);
      for (int l = i; l < count; l++) {
        for (int k = i; k < l; k++) {
          inverse[l] -= L[l][k] * inverse[k];
        }
        variance[i] += (D[l] > AMB_C(0.0)) ? ((inverse[l] * inverse[l]) / D[l]) : AMB_C(0.0);
      }
    }
  }
  return sum;
}

/* Columns of one fault, or of two. */
static int columns_of(const amb_isolation *iso, int j, int l, int column[MOST_COLUMNS])
{
  int count = 0;
  for (int k = 0; k < (int)iso->fault[j].columns; k++) {
    column[count] = (int)iso->fault[j].column + k;
    count++;
  }
  for (int k = 0; (l >= 0) && (k < (int)iso->fault[l].columns); k++) {
    column[count] = (int)iso->fault[l].column + k;
    count++;
  }
  return count;
}

static amb_real likelihood(const amb_isolation *iso, const sweep *w, int j, int l)
{
  int column[MOST_COLUMNS];
  return explained(iso, w, columns_of(iso, j, l, column), column, NULL, NULL);
}

/* Keep the best likelihood of each fault. */
static void keep_best(const amb_isolation *iso, const sweep *w, int since, bool before,
                      amb_isolation_result result[])
{
  for (int j = 0; j < iso->faults; j++) {
    const amb_real l = likelihood(iso, w, j, -1);
    if (l > result[j].likelihood) {
      result[j].likelihood = l;
      result[j].since = since;
      result[j].before = before;
    }
  }
}

static int samples_in(const amb_isolation *iso, const amb_isolation_state *state)
{
  const int filled = state->filled - 1; /* the first has no past */
  return (filled < iso->window) ? filled : iso->window;
}

/* The sweep to where a fault began, with all of M. */
static sweep to_begin(const amb_isolation *iso, const amb_isolation_state *state, int newest,
                      int since, bool before)
{
  sweep w = amb_sweep_begin(iso, state, true);
  for (int ago = 0; ago < since; ago++) {
    amb_sweep_back(iso, state, newest, ago, &w);
  }
  if (before) {
    (void)amb_sweep_eliminate_start(iso, &w);
  }
  return w;
}

static void write_sizes(const amb_isolation *iso, const sweep *w, int j, int l,
                        amb_isolation_result result[])
{
  int column[MOST_COLUMNS];
  amb_real size[MOST_COLUMNS];
  amb_real variance[MOST_COLUMNS];
  const int count = columns_of(iso, j, l, column);
  (void)explained(iso, w, count, column, size, variance);
  for (int k = 0; k < count; k++) {
    const int own = (int)iso->fault[j].columns;
    amb_isolation_result *of = (k < own) ? &result[j] : &result[l];
    of->size[(k < own) ? k : (k - own)] = size[k];
    of->variance[(k < own) ? k : (k - own)] = variance[k];
  }
}

/* Whether two faults are of one group. */
static bool are_alike(const amb_isolation *iso, int j, int k)
{
  return (j != k) && (iso->fault[j].group > 0U) && (iso->fault[j].group == iso->fault[k].group);
}

/* The share of what a fault explains by which another one must differ from it. */
static amb_real share_of(const amb_isolation *iso, int j, int k)
{
  return are_alike(iso, j, k) ? iso->alike : iso->like;
}

/* Two faults, and what they explain together since so many samples. */
typedef struct pair {
  int of[2];
  int since;
  amb_real most;
  amb_real adds[2]; /* what each explains beside the other */
} pair;

static void keep_best_two(const amb_isolation *iso, const sweep *w, int since, pair *best)
{
  for (int j = 0; j < iso->faults; j++) {
    for (int l = j + 1; l < iso->faults; l++) {
      const amb_real both = likelihood(iso, w, j, l);
      if (both > best->most) {
        best->of[0] = j;
        best->of[1] = l;
        best->since = since;
        best->most = both;
      }
    }
  }
}

/* The likeliest two that began where one of them does by itself. */
static pair likeliest_two(const amb_isolation *iso, const amb_isolation_state *state, int newest,
                          int samples, const amb_isolation_result result[], bool before)
{
  pair best;
  best.of[0] = 0;
  best.of[1] = 0;
  best.since = samples;
  best.most = AMB_C(0.0);
  sweep w = amb_sweep_begin(iso, state, true);
  for (int ago = 0; ago < samples; ago++) {
    bool begins = false;
    amb_sweep_back(iso, state, newest, ago, &w);
    for (int j = 0; j < iso->faults; j++) {
      begins = begins || (result[j].since == (ago + 1));
    }
    if (begins && !before) {
      keep_best_two(iso, &w, ago + 1, &best);
    }
  }
  if (before) {
    (void)amb_sweep_eliminate_start(iso, &w);
    keep_best_two(iso, &w, samples, &best);
  }
  for (int k = 0; k < 2; k++) {
    best.adds[k] = best.most - result[best.of[1 - k]].likelihood;
  }
  return best;
}

/* Whether no single fault explains nearly as much as two. */
static bool needs_two(const amb_isolation *iso, const amb_isolation_result result[],
                      const pair *two, amb_real limit)
{
  bool needed = !are_alike(iso, two->of[0], two->of[1]);
  for (int j = 0; j < iso->faults; j++) {
    amb_real least = amb_at_least(limit, AMB_C(2.0) * iso->like * two->most);
    for (int k = 0; k < 2; k++) {
      const bool alike = are_alike(iso, j, two->of[k]);
      least = alike ? amb_at_least(least, AMB_C(2.0) * iso->alike * two->adds[k]) : least;
    }
    needed = needed && ((two->most - result[j].likelihood) >= least);
  }
  return needed;
}

/* In whose place of the two a fault explains as much: beside the other, or beside any; -1: none. */
static int instead_of_two(const amb_isolation *iso, const sweep *w, int j, const pair *two,
                          amb_real least)
{
  const amb_real less = amb_at_most(two->adds[0], two->adds[1]);
  int place = -1;
  amb_real best = AMB_C(0.0);
  for (int k = 0; k < 2; k++) {
    const amb_real margin = amb_at_least(least, share_of(iso, j, two->of[k]) * two->adds[k]);
    const amb_real both = (j == two->of[k]) ? two->most : likelihood(iso, w, j, two->of[1 - k]);
    if ((both > best) && ((two->most - both) < margin)) {
      best = both;
      place = two->of[k];
    }
  }
  for (int l = 0; (place < 0) && (l < iso->faults); l++) {
    const amb_real left = two->most - likelihood(iso, w, j, l);
    place = ((l != j) && (left < amb_at_least(least, iso->like * less))) ? two->of[0] : -1;
  }
  return place;
}

static void name_two(const amb_isolation *iso, const sweep *w, const pair *two, amb_real least,
                     amb_isolation_result result[])
{
  for (int j = 0; j < iso->faults; j++) {
    result[j].instead = instead_of_two(iso, w, j, two, least);
  }
  for (int k = 0; k < 2; k++) {
    result[two->of[k]].since = two->since;
  }
  write_sizes(iso, w, two->of[0], two->of[1], result);
}

static void name_one(const amb_isolation *iso, const sweep *w, int first, amb_real least,
                     amb_isolation_result result[])
{
  const amb_real most = result[first].likelihood;
  for (int j = 0; j < iso->faults; j++) {
    const amb_real margin = amb_at_least(least, share_of(iso, j, first) * most);
    result[j].instead = ((most - result[j].likelihood) < margin) ? first : -1;
    write_sizes(iso, w, j, -1, result);
  }
}

static void name_none(const amb_isolation *iso, amb_isolation_result result[])
{
  for (int j = 0; j < iso->faults; j++) {
    amb_isolation_result *of = &result[j];
    of->likelihood = AMB_C(0.0);
    amb_clear(2, of->size);
    amb_clear(2, of->variance);
    of->since = 0;
    of->before = false;
    of->instead = -1;
  }
}

static int likeliest(const amb_isolation *iso, const amb_isolation_result result[])
{
  int first = 0;
  for (int j = 1; j < iso->faults; j++) {
    first = (result[j].likelihood > result[first].likelihood) ? j : first;
  }
  return first;
}

/* The scale of the innovations by what is left of them. */
static amb_real scale_of(const amb_isolation *iso, int samples, amb_real left)
{
  return amb_at_least(left / ((amb_real)samples * (amb_real)iso->sensors), AMB_C(1.0));
}

int amb_isolation_evaluate(const amb_isolation *iso, const amb_isolation_state *state,
                           amb_isolation_result result[])
{
  const int samples = samples_in(iso, state); /* first: more may come in between */
  const unsigned int count = state->count;
  const int newest = state->newest;
  name_none(iso, result);
  if ((samples < AMB_ISOLATION_LEAST) || (state->contact < free_of(iso))) {
    return 0;
  }
  sweep w = amb_sweep_begin(iso, state, false);
  for (int ago = 0; ago < samples; ago++) {
    amb_sweep_back(iso, state, newest, ago, &w);
    if ((ago + 1) >= AMB_ISOLATION_LEAST) {
      keep_best(iso, &w, ago + 1, false, result);
    }
  }
  const amb_real energy = w.energy;
  const amb_real start = amb_sweep_eliminate_start(iso, &w);
  amb_real known = AMB_C(0.0);
  int first = likeliest(iso, result);
  if ((start - (amb_real)iso->states) > (result[first].likelihood - iso->margin)) {
    known = start; /* something before the window explains as much as what began in it */
    name_none(iso, result);
    keep_best(iso, &w, samples, true, result);
    first = likeliest(iso, result);
  }
  const amb_real most = result[first].likelihood;
  const amb_real unexplained = energy - known;
  amb_real scale = scale_of(iso, samples, unexplained - most);
  int named = 0;
  if (most >= (iso->limit * scale)) {
    const bool before = result[first].before;
    w = to_begin(iso, state, newest, result[first].since, before);
    name_one(iso, &w, first, iso->margin * scale, result);
    named = 1;
    pair two;
    two = likeliest_two(iso, state, newest, samples, result, before);
    const amb_real scale_of_two = scale_of(iso, samples, unexplained - two.most);
    if (needs_two(iso, result, &two, iso->limit * scale_of_two)) {
      w = to_begin(iso, state, newest, two.since, before);
      scale = scale_of_two;
      name_two(iso, &w, &two, iso->margin * scale, result);
      named = 2;
    }
  }
  for (int j = 0; j < iso->faults; j++) {
    result[j].likelihood /= scale;
    result[j].variance[0] *= scale;
    result[j].variance[1] *= scale;
  }
  if ((state->count - count) > (unsigned int)iso->spare) { /* what was read was written over */
    name_none(iso, result);
    named = -1;
  }
  return named;
}

void amb_isolation_information(const amb_isolation *iso, const amb_isolation_state *state,
                               int since, bool before, amb_real information[])
{
  const int samples = samples_in(iso, state);
  const sweep w = to_begin(iso, state, state->newest, (since < samples) ? since : samples, before);
  for (int j = 0; j < iso->columns; j++) {
    for (int l = 0; l < iso->columns; l++) {
      information[(j * iso->columns) + l] = entry(iso, &w, j, l);
    }
  }
}
