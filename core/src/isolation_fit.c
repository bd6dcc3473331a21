#include "isolation_fit.h"

/* Columns of one fault, or of two (l < 0: of one). */
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

amb_real amb_fit_likelihood(const amb_isolation *iso, const sweep *w, int j, int l, amb_real size[],
                            amb_real variance[])
{
  int column[MOST_COLUMNS];
  amb_real M[MOST_COLUMNS][MOST_COLUMNS];
  amb_real g[MOST_COLUMNS];
  const int count = columns_of(iso, j, l, column);
  for (int i = 0; i < count; i++) {
    g[i] = w->g[column[i]];
    for (int k = 0; k <= i; k++) {
      M[i][k] = entry(iso, w, column[i], column[k]);
    }
  }
  return amb_explained(count, M, g, size, variance);
}

bool amb_fit_alike(const amb_isolation *iso, int j, int k)
{
  return (j != k) && (iso->fault[j].group > 0U) && (iso->fault[j].group == iso->fault[k].group);
}

static replay begin_fit(const amb_isolation *iso, int j, int l, int since)
{
  replay fit;
  fit.columns = columns_of(iso, j, l, fit.column);
  fit.since = since;
  fit.promised = false;
  fit.explains = AMB_C(0.0);
  fit.correlated = AMB_C(0.0);
  amb_clear(MOST_COLUMNS, fit.size);
  amb_clear(MOST_COLUMNS, fit.variance);
  return fit;
}

/* Fit with another onset, and keep the fit that explains more. */
static bool fit_since(const window *in, int since, replay *fit)
{
  replay other = *fit;
  other.since = since;
  if ((since >= AMB_ISOLATION_LEAST) && (since <= in->samples)) {
    amb_replay_fit(&in->data, &other);
  }
  const bool better = other.explains > fit->explains;
  if (better) {
    *fit = other;
  }
  return better;
}

/* Search the onset in both directions by steps that double while the fit gets better. */
static void find_onset(const window *in, replay *fit)
{
  for (int way = 1; way >= -1; way -= 2) {
    int step = way;
    bool better = true;
    for (int k = 0; (k < 4) && (better || (step != way)); k++) {
      step = better ? step : way;
      better = fit_since(in, fit->since + step, fit);
      step = better ? (2 * step) : step;
    }
  }
}

void amb_fit_write(const replay *fit, int from, int count, amb_isolation_result *of)
{
  of->since = fit->since;
  amb_copy(count, fit->size + from, of->size);
  amb_copy(count, fit->variance + from, of->variance);
}

amb_real amb_fit_scale(const window *in, amb_real explained)
{
  const amb_real number = (amb_real)in->samples * (amb_real)in->data.iso->sensors;
  return amb_at_least((in->unexplained - explained) / number, in->roughness);
}

amb_real amb_fit_missed(const window *in, const replay *fit, amb_real scale)
{
  const amb_real number = (amb_real)fit->since * (amb_real)in->data.iso->sensors;
  const amb_real chance = scale * ((AMB_C(0.1) * number) + AMB_C(16.0));
  return amb_at_least(amb_magnitude(fit->correlated) - chance, AMB_C(0.0));
}

static replay fit_of(const window *in, int j, const amb_isolation_result *of)
{
  replay fit = begin_fit(in->data.iso, j, -1, of->since);
  fit.explains = of->likelihood;
  amb_copy(fit.columns, of->size, fit.size);
  amb_copy(fit.columns, of->variance, fit.variance);
  return fit;
}

static void keep_fit(const replay *fit, amb_isolation_result *of)
{
  of->likelihood = fit->explains;
  amb_fit_write(fit, 0, fit->columns, of);
}

/* Try another onset for each fault that was replayed. */
static void replay_since(const window *in, int since, amb_isolation_result result[])
{
  for (int j = 0; j < in->data.iso->faults; j++) {
    replay fit = fit_of(in, j, &result[j]);
    if ((fit.variance[0] > AMB_C(0.0)) && (fit.since != since) && fit_since(in, since, &fit)) {
      keep_fit(&fit, &result[j]);
    }
  }
}

int amb_fit_singles(window *in, int first, amb_isolation_result result[])
{
  const amb_isolation *iso = in->data.iso;
  const amb_real least = AMB_C(0.5) * result[first].likelihood;
  for (int j = 0; j < iso->faults; j++) {
    if (result[j].likelihood >= least) {
      replay fit = begin_fit(iso, j, -1, result[j].since);
      amb_replay_fit(&in->data, &fit);
      keep_fit(&fit, &result[j]);
    }
  }
  replay_since(in, in->begin, result);
  int best = first;
  for (int j = 0; j < iso->faults; j++) {
    const bool replayed = result[j].variance[0] > AMB_C(0.0);
    best = (replayed && (result[j].likelihood > result[best].likelihood)) ? j : best;
  }
  replay fit = fit_of(in, best, &result[best]);
  find_onset(in, &fit);
  keep_fit(&fit, &result[best]);
  replay_since(in, fit.since, result);
  in->missed = amb_fit_missed(in, &fit, amb_fit_scale(in, fit.explains));
  return best;
}

/* Keep a pair if it is one of the likeliest; of each pair the likelier onset. */
static void keep_pair(int j, int l, const replay *fit, pairs *list)
{
  int at = (list->count < PAIRS) ? list->count : 0;
  for (int k = 0; (list->count >= PAIRS) && (k < PAIRS); k++) {
    const bool less = list->likely[k].fit.explains < list->likely[at].fit.explains;
    at = less ? k : at;
  }
  for (int k = 0; k < list->count; k++) {
    at = ((list->likely[k].of[0] == j) && (list->likely[k].of[1] == l)) ? k : at;
  }
  if ((at >= list->count) || (fit->explains > list->likely[at].fit.explains)) {
    list->count = (at >= list->count) ? (at + 1) : list->count;
    list->likely[at].of[0] = j;
    list->likely[at].of[1] = l;
    list->likely[at].fit = *fit;
  }
}

/* Keep the likeliest pairs by the linearised signatures. */
static void keep_pairs(const amb_isolation *iso, const sweep *w, int since, pairs *list)
{
  for (int j = 0; j < iso->faults; j++) {
    for (int l = j + 1; l < iso->faults; l++) {
      replay fit = begin_fit(iso, j, l, since);
      fit.explains = amb_fit_likelihood(iso, w, j, l, fit.size, fit.variance);
      keep_pair(j, l, &fit, list);
    }
  }
}

/* Keep the likeliest pairs of a fault that was fitted, and another one: by the signatures along the
 * run with the first. */
static void keep_pairs_of(const window *in, int of, const amb_isolation_result *one, pairs *list)
{
  const amb_isolation *iso = in->data.iso;
  for (int j = 0; j < iso->faults; j++) {
    if (j != of) {
      const bool later = j < of;
      replay fit = begin_fit(iso, later ? j : of, later ? of : j, one->since);
      amb_copy((int)iso->fault[of].columns, one->size,
               fit.size + (later ? (int)iso->fault[j].columns : 0));
      amb_replay_promise(&in->data, &fit);
      keep_pair(later ? j : of, later ? of : j, &fit, list);
    }
  }
}

static void find_best(pairs *list)
{
  for (int k = 0; k < list->count; k++) {
    const bool more = list->likely[k].fit.explains > list->likely[list->best].fit.explains;
    list->best = more ? k : list->best;
  }
}

/* Linearised sizes of the faults that were not replayed. */
static void size_rest(const amb_isolation *iso, const sweep *w, amb_isolation_result result[])
{
  for (int j = 0; j < iso->faults; j++) {
    if (!(result[j].variance[0] > AMB_C(0.0))) {
      (void)amb_fit_likelihood(iso, w, j, -1, result[j].size, result[j].variance);
    }
  }
}

/* Replay the two faults of the best pair, each by itself. */
static void replay_members(const window *in, const pair *two, amb_isolation_result result[])
{
  for (int k = 0; k < 2; k++) {
    replay fit = begin_fit(in->data.iso, two->of[k], -1, two->fit.since);
    amb_replay_fit(&in->data, &fit);
    if (fit.explains > result[two->of[k]].likelihood) {
      keep_fit(&fit, &result[two->of[k]]);
    }
  }
}

void amb_fit_pairs(const window *in, int of, amb_isolation_result result[], pairs *list)
{
  const int since = result[of].since;
  list->count = 0;
  list->best = 0;
  if (result[of].before) {
    const sweep w = amb_sweep_to(&in->data, in->samples, true);
    size_rest(in->data.iso, &w, result);
    keep_pairs(in->data.iso, &w, in->samples, list);
    find_best(list);
  } else {
    sweep w = amb_sweep_begin(&in->data, true);
    for (int ago = 0; (ago < since) || (ago < in->begin); ago++) {
      amb_sweep_back(&in->data, ago, &w);
      if ((ago + 1) == since) {
        size_rest(in->data.iso, &w, result);
      }
      if (((ago + 1) == since) || ((ago + 1) == in->begin)) {
        keep_pairs(in->data.iso, &w, ago + 1, list);
      }
    }
    keep_pairs_of(in, of, &result[of], list);
    for (int k = 0; k < list->count; k++) {
      replay *fit = &list->likely[k].fit;
      if (fit->promised) {
        fit->explains = AMB_C(0.0);
      } else {
        *fit = begin_fit(in->data.iso, list->likely[k].of[0], list->likely[k].of[1], fit->since);
      }
      amb_replay_fit(&in->data, fit);
    }
    find_best(list);
    find_onset(in, &list->likely[list->best].fit);
    const replay *best = &list->likely[list->best].fit;
    const int at = best->since;
    const amb_real near = amb_at_least((AMB_C(1.0) - in->data.iso->like) * best->explains,
                                       result[of].likelihood + in->data.iso->margin);
    for (int k = 0; k < list->count; k++) {
      replay *fit = &list->likely[k].fit;
      if (fit->since != at) {
        (void)fit_since(in, at, fit);
      }
      if (fit->explains > near) {
        find_onset(in, fit);
      }
    }
    find_best(list);
    replay_members(in, &list->likely[list->best], result);
  }
}
