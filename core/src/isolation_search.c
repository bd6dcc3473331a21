#include "isolation_replay.h"
#include "isolation_sweep.h"

#define PAIRS 8 /* that are replayed */

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

/* l of one or two faults; their sizes and variances where wanted. */
static amb_real likelihood(const amb_isolation *iso, const sweep *w, int j, int l, amb_real size[],
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

/* Keep the best likelihood of each fault. */
static void keep_best(const amb_isolation *iso, const sweep *w, int since, bool before,
                      amb_isolation_result result[])
{
  for (int j = 0; j < iso->faults; j++) {
    const int own = (int)iso->fault[j].column;
    const amb_real M = entry(iso, w, own, own);
    const amb_real g = w->g[own];
    const amb_real by_itself = (M > AMB_C(0.0)) ? ((g * g) / M) : AMB_C(0.0);
    const bool one = iso->fault[j].columns == 1U;
    const amb_real l = one ? by_itself : likelihood(iso, w, j, -1, NULL, NULL);
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

/* Whether two faults are of one group. */
static bool are_alike(const amb_isolation *iso, int j, int k)
{
  return (j != k) && (iso->fault[j].group > 0U) && (iso->fault[j].group == iso->fault[k].group);
}

/* What is searched: the window behind the newest sample, and what its first sweep says of it. */
typedef struct window {
  const amb_isolation *iso;
  const amb_isolation_state *state;
  int newest;
  int samples;
  int begin;            /* since when the innovations are too large */
  amb_real unexplained; /* sum of e^2 / S */
  amb_real missed;      /* what the likeliest fault leaves beyond chance */
  amb_real share;       /* of l, that signatures may miss */
} window;

/* Two faults, and what they explain together. */
typedef struct pair {
  int of[2];
  replay fit;
} pair;

typedef struct pairs {
  int count;
  int best;
  pair likely[PAIRS];
} pairs;

/* The share of what a fault explains by which another one must differ from it. */
static amb_real share_of(const window *in, int j, int k)
{
  return are_alike(in->iso, j, k) ? in->iso->alike : in->share;
}

static replay begin_fit(const amb_isolation *iso, int j, int l, int since)
{
  replay fit;
  fit.columns = columns_of(iso, j, l, fit.column);
  fit.since = since;
  fit.explains = AMB_C(0.0);
  fit.correlated = AMB_C(0.0);
  amb_clear(MOST_COLUMNS, fit.size);
  amb_clear(MOST_COLUMNS, fit.variance);
  return fit;
}

/* Fit with another begin, and keep what explains more. */
static bool fit_since(const window *in, int since, replay *fit)
{
  replay other = *fit;
  other.since = since;
  if ((since >= AMB_ISOLATION_LEAST) && (since <= in->samples)) {
    amb_replay_fit(in->iso, in->state, in->newest, &other);
  }
  const bool better = other.explains > fit->explains;
  if (better) {
    *fit = other;
  }
  return better;
}

/* The begin in whose neighbourhood faults explain most. */
static void find_begin(const window *in, replay *fit)
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

static void write_sizes(const replay *fit, int from, int count, amb_isolation_result *of)
{
  of->since = fit->since;
  amb_copy(count, fit->size + from, of->size);
  amb_copy(count, fit->variance + from, of->variance);
}

/* The scale of the innovations by what is left of them. */
static amb_real scale_of(const window *in, amb_real explained)
{
  const amb_real number = (amb_real)in->samples * (amb_real)in->iso->sensors;
  return amb_at_least((in->unexplained - explained) / number, AMB_C(1.0));
}

/* What faults leave beyond chance, where noise has this scale: residuals that are correlated. */
static amb_real missed_by(const window *in, const replay *fit, amb_real scale)
{
  const amb_real number = (amb_real)fit->since * (amb_real)in->iso->sensors;
  const amb_real chance = scale * ((AMB_C(0.1) * number) + AMB_C(16.0));
  return amb_at_least(amb_magnitude(fit->correlated) - chance, AMB_C(0.0));
}

static replay fit_of(const window *in, int j, const amb_isolation_result *of)
{
  replay fit = begin_fit(in->iso, j, -1, of->since);
  fit.explains = of->likelihood;
  amb_copy(fit.columns, of->size, fit.size);
  amb_copy(fit.columns, of->variance, fit.variance);
  return fit;
}

static void keep_fit(const replay *fit, amb_isolation_result *of)
{
  of->likelihood = fit->explains;
  write_sizes(fit, 0, fit->columns, of);
}

/* Fit the replayed faults with another begin too. */
static void replay_since(const window *in, int since, amb_isolation_result result[])
{
  for (int j = 0; j < in->iso->faults; j++) {
    replay fit = fit_of(in, j, &result[j]);
    if ((fit.variance[0] > AMB_C(0.0)) && (fit.since != since) && fit_since(in, since, &fit)) {
      keep_fit(&fit, &result[j]);
    }
  }
}

/* Replay the faults that explain at least half as much as the likeliest one. */
static int replay_singles(window *in, int first, amb_isolation_result result[])
{
  const amb_isolation *iso = in->iso;
  const amb_real least = AMB_C(0.5) * result[first].likelihood;
  for (int j = 0; j < iso->faults; j++) {
    if (result[j].likelihood >= least) {
      replay fit = begin_fit(iso, j, -1, result[j].since);
      amb_replay_fit(iso, in->state, in->newest, &fit);
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
  find_begin(in, &fit);
  keep_fit(&fit, &result[best]);
  replay_since(in, fit.since, result);
  in->missed = missed_by(in, &fit, scale_of(in, fit.explains));
  return best;
}

/* Keep the likeliest pairs by the linearised signatures. */
static void keep_pairs(const amb_isolation *iso, const sweep *w, int since, pairs *list)
{
  for (int j = 0; j < iso->faults; j++) {
    for (int l = j + 1; l < iso->faults; l++) {
      replay fit = begin_fit(iso, j, l, since);
      fit.explains = likelihood(iso, w, j, l, fit.size, fit.variance);
      int at = (list->count < PAIRS) ? list->count : 0;
      for (int k = 0; (list->count >= PAIRS) && (k < PAIRS); k++) {
        const bool less = list->likely[k].fit.explains < list->likely[at].fit.explains;
        at = less ? k : at;
      }
      for (int k = 0; k < list->count; k++) {
        at = ((list->likely[k].of[0] == j) && (list->likely[k].of[1] == l)) ? k : at;
      }
      if ((at >= list->count) || (fit.explains > list->likely[at].fit.explains)) {
        list->count = (at >= list->count) ? (at + 1) : list->count;
        list->likely[at].of[0] = j;
        list->likely[at].of[1] = l;
        list->likely[at].fit = fit;
      }
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
      (void)likelihood(iso, w, j, -1, result[j].size, result[j].variance);
    }
  }
}

/* The likeliest two that began where one does by itself, or where the innovations grew. */
static void find_pairs(const window *in, int of, amb_isolation_result result[], pairs *list)
{
  const int since = result[of].since;
  list->count = 0;
  list->best = 0;
  if (result[of].before) {
    const sweep w = to_begin(in->iso, in->state, in->newest, in->samples, true);
    size_rest(in->iso, &w, result);
    keep_pairs(in->iso, &w, in->samples, list);
    find_best(list);
  } else {
    sweep w = amb_sweep_begin(in->iso, in->state, true);
    for (int ago = 0; (ago < since) || (ago < in->begin); ago++) {
      amb_sweep_back(in->iso, in->state, in->newest, ago, &w);
      if ((ago + 1) == since) {
        size_rest(in->iso, &w, result);
      }
      if (((ago + 1) == since) || ((ago + 1) == in->begin)) {
        keep_pairs(in->iso, &w, ago + 1, list);
      }
    }
    for (int k = 0; k < list->count; k++) {
      pair *two = &list->likely[k];
      two->fit = begin_fit(in->iso, two->of[0], two->of[1], two->fit.since);
      amb_replay_fit(in->iso, in->state, in->newest, &two->fit);
    }
    find_best(list);
    find_begin(in, &list->likely[list->best].fit);
    const int best = list->likely[list->best].fit.since;
    for (int k = 0; k < list->count; k++) {
      if (list->likely[k].fit.since != best) {
        (void)fit_since(in, best, &list->likely[k].fit);
      }
    }
    find_best(list);
  }
}

/* What a fault of two explains beside the other. */
static amb_real adds(const pair *two, int k, const amb_isolation_result result[])
{
  return two->fit.explains - result[two->of[1 - k]].likelihood;
}

/* Whether no single fault explains nearly as much as two. */
static bool needs_two(const window *in, const amb_isolation_result result[], const pair *two,
                      amb_real scale)
{
  const amb_isolation *iso = in->iso;
  bool needed = !are_alike(iso, two->of[0], two->of[1]);
  for (int j = 0; j < iso->faults; j++) {
    amb_real least = amb_at_least(iso->limit * scale, AMB_C(2.0) * in->share * two->fit.explains);
    least = amb_at_least(least, AMB_C(3.0) * missed_by(in, &two->fit, scale));
    for (int k = 0; k < 2; k++) {
      const bool alike = are_alike(iso, j, two->of[k]);
      least = alike ? amb_at_least(least, AMB_C(2.0) * iso->alike * adds(two, k, result)) : least;
    }
    needed = needed && ((two->fit.explains - result[j].likelihood) >= least);
  }
  return needed;
}

/* In whose place of the two a fault explains as much: beside the other, or beside any; -1: none. */
static int instead_of_two(const window *in, int j, const pairs *list, amb_real least,
                          const amb_isolation_result result[])
{
  const pair *two = &list->likely[list->best];
  const amb_real most = two->fit.explains;
  const amb_real less = amb_at_most(adds(two, 0, result), adds(two, 1, result));
  int place = -1;
  int any = -1;
  amb_real best = AMB_C(0.0);
  for (int q = 0; q < list->count; q++) {
    const pair *other = &list->likely[q];
    const amb_real both = other->fit.explains;
    const bool has = (other->of[0] == j) || (other->of[1] == j);
    for (int k = 0; has && (k < 2); k++) {
      const int beside = (other->of[0] == j) ? other->of[1] : other->of[0];
      const amb_real margin =
          amb_at_least(least, share_of(in, j, two->of[k]) * adds(two, k, result));
      if ((beside == two->of[1 - k]) && (both > best) && ((most - both) < margin)) {
        best = both;
        place = two->of[k];
      }
    }
    any = (has && ((most - both) < amb_at_least(least, in->share * less))) ? two->of[0] : any;
  }
  return (place >= 0) ? place : any;
}

static void name_two(const window *in, const pairs *list, amb_real least,
                     amb_isolation_result result[])
{
  const pair *two = &list->likely[list->best];
  for (int j = 0; j < in->iso->faults; j++) {
    result[j].instead = instead_of_two(in, j, list, least, result);
  }
  const int own = (int)in->iso->fault[two->of[0]].columns;
  write_sizes(&two->fit, 0, own, &result[two->of[0]]);
  write_sizes(&two->fit, own, two->fit.columns - own, &result[two->of[1]]);
}

static void name_one(const window *in, int first, amb_real least, amb_isolation_result result[])
{
  const amb_real most = result[first].likelihood;
  for (int j = 0; j < in->iso->faults; j++) {
    const amb_real margin = amb_at_least(least, share_of(in, j, first) * most);
    result[j].instead = ((most - result[j].likelihood) < margin) ? first : -1;
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

#define MOST_HALVINGS 40

/* Natural logarithm of a number from 1 to 1e12, to 1e-4. */
static amb_real logarithm(amb_real x)
{
  amb_real sum = AMB_C(0.0);
  amb_real m = x;
  for (int k = 0; k < MOST_HALVINGS; k++) {
    if (m > AMB_C(1.5)) {
      m *= AMB_C(0.5);
      sum += AMB_C(0.6931471805599453);
    }
  }
  const amb_real q = (m - AMB_C(1.0)) / (m + AMB_C(1.0));
  return sum + (AMB_C(2.0) * q * (AMB_C(1.0) + (q * q / AMB_C(3.0))));
}

/* By how much the innovations of the last samples are likelier with a variance of their own. */
static amb_real too_large(const amb_isolation *iso, int samples, amb_real energy)
{
  const amb_real number = (amb_real)samples * (amb_real)iso->sensors;
  const amb_real mean = amb_clamp(energy / number, AMB_C(1.0), AMB_C(1e12));
  return number * (mean - AMB_C(1.0) - logarithm(mean));
}

/* The first sweep: the best likelihoods of each fault, and what else is in the window. */
static int sweep_singles(window *in, amb_isolation_result result[])
{
  const amb_isolation *iso = in->iso;
  amb_real largest = AMB_C(0.0);
  sweep w = amb_sweep_begin(iso, in->state, false);
  in->begin = in->samples;
  for (int ago = 0; ago < in->samples; ago++) {
    amb_sweep_back(iso, in->state, in->newest, ago, &w);
    if ((ago + 1) >= AMB_ISOLATION_LEAST) {
      const amb_real large = too_large(iso, ago + 1, w.energy);
      in->begin = (large > largest) ? (ago + 1) : in->begin;
      largest = amb_at_least(large, largest);
      keep_best(iso, &w, ago + 1, false, result);
    }
  }
  in->unexplained = w.energy;
  const amb_real start = amb_sweep_eliminate_start(iso, &w);
  int first = likeliest(iso, result);
  if ((start - (amb_real)iso->states) > (result[first].likelihood - iso->margin)) {
    in->unexplained -= start; /* what was before the window explains as much as what began in it */
    name_none(iso, result);
    keep_best(iso, &w, in->samples, true, result);
    first = likeliest(iso, result);
  }
  return first;
}

/* Names of the likeliest fault, or of two; returns how many, and writes the scale. */
static int name_likeliest(window *in, int of, amb_isolation_result result[], amb_real *scale)
{
  const amb_isolation *iso = in->iso;
  const bool before = result[of].before;
  int first = of;
  int named = 1;
  pairs list;
  if (before) {
    in->share = iso->like;
  } else {
    in->share = iso->fine;
    first = replay_singles(in, of, result);
    *scale = scale_of(in, result[first].likelihood);
  }
  find_pairs(in, first, result, &list);
  const pair *two = &list.likely[list.best];
  const amb_real scale_of_two = scale_of(in, two->fit.explains);
  if (needs_two(in, result, two, scale_of_two)) {
    *scale = scale_of_two;
    const amb_real margin = iso->margin * scale_of_two;
    name_two(in, &list, amb_at_least(margin, missed_by(in, &two->fit, scale_of_two)), result);
    named = 2;
  } else {
    const amb_real margin = iso->margin * *scale;
    name_one(in, first, amb_at_least(margin, in->missed), result);
  }
  return named;
}

int amb_isolation_evaluate(const amb_isolation *iso, const amb_isolation_state *state,
                           amb_isolation_result result[])
{
  const unsigned int count = state->count;
  window in;
  in.iso = iso;
  in.state = state;
  in.samples = samples_in(iso, state); /* first: more may come in between */
  in.newest = state->newest;
  in.share = iso->like;
  in.missed = AMB_C(0.0);
  name_none(iso, result);
  if ((in.samples < AMB_ISOLATION_LEAST) || (state->contact < free_of(iso))) {
    return 0;
  }
  const int first = sweep_singles(&in, result);
  amb_real scale = scale_of(&in, result[first].likelihood);
  int named = 0;
  if (result[first].likelihood >= (iso->limit * scale)) {
    named = name_likeliest(&in, first, result, &scale);
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
