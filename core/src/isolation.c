#include "ambkit/root.h"
#include "isolation_restart.h"
#include "kalman_step.h"

/* A rotor counts as on its stop from this share of its travel on. */
#define ON_STOP AMB_C(0.95)

/* Blocks that the roughness remembers, those that its start counts for, and the most that a block
 * counts for, so that a short fault does not pass for a rough load. */
#define REMEMBERED 64
#define START 8
#define MOST AMB_C(9.0)

int amb_isolation_row(const amb_isolation *iso)
{
  return (ROW_OF_FORCE * iso->forces) + (AMB_OF_SENSOR * iso->sensors) + iso->forms +
         (2 * iso->tones) + (iso->sensors * (2 + iso->states));
}

int amb_isolation_work(const amb_isolation *iso)
{
  const int n = iso->states;
  const int c = iso->columns;
  return (2 * n) + (2 * n * n) + (c * n) + (4 * c) + (c * c);
}

void amb_isolation_reset(const amb_isolation *iso, amb_isolation_state *state)
{
  state->newest = iso->window + iso->spare - 1;
  state->count = 0U;
  state->contact = free_of(iso);
  state->filled = 0;
  state->seen = 0;
  state->apart = false;
  state->held = 0;
  state->holds = 0;
  amb_clear(AMB_STATES, state->mean);
  amb_clear(AMB_SENSORS, state->read);
  amb_clear(AMB_SENSORS, state->lagged);
  state->block = 0;
  state->blocks = -AMB_ISOLATION_RECENT;
  for (int r = 0; r < AMB_SENSORS; r++) {
    state->roughness[r] = AMB_C(1.0);
  }
  for (int k = 0; k < AMB_ISOLATION_RECENT; k++) {
    amb_clear(AMB_SENSORS, state->recent[k]);
  }
  for (int k = 0; k <= AMB_ISOLATION_LEAST; k++) {
    amb_clear(AMB_FORCES, state->current[k]);
  }
}

/* Half the sum of the pulls of both coils, from their difference F and
 * k_i = 2 upper / (i0 + i) + 2 lower / (i0 - i): a pull grows with the square of the current. */
static amb_real both_coils(amb_real i0, amb_real i, amb_real F, amb_real k_i)
{
  const amb_real both = (AMB_C(0.5) * k_i * ((i0 * i0) - (i * i))) + (F * i);
  return (amb_magnitude(i0) > AMB_C(0.0)) ? (both / (AMB_C(2.0) * i0)) : AMB_C(0.0);
}

/* Currents that acted since the last sample, and the displacements that they acted at. */
static void put_forces(const amb_isolation *iso, amb_isolation_state *state, const amb_kalman *kf,
                       const amb_real iu[AMB_CONTROLS], amb_real *row)
{
  for (int k = AMB_ISOLATION_LEAST; k > 0; k--) {
    amb_copy(iso->forces, state->current[k - 1], state->current[k]);
  }
  for (int f = 0; f < iso->forces; f++) {
    amb_real *to = row + (ROW_OF_FORCE * f);
    state->current[0][f] = amb_model_current(&kf->model, f, state->mean, iu);
    to[0] = state->current[0][f];
    to[1] = amb_model_displacement(&kf->model, f, state->mean);
    to[2] = state->current[iso->late][f];
  }
}

/* A third of what a larger air gap takes from the force F + F_0, over its relative change: k_s is
 * about the change of that by s. */
static amb_real by_gap(const samples *of, int f, amb_real i, amb_real s, amb_real F, amb_real k_s,
                       amb_real gap)
{
  const amb_real sum = F + of->iso->F_0[f];
  amb_real less = (AMB_C(2.0) * sum) + (k_s * s);
  if (amb_magnitude(gap) > AMB_C(1e-3)) {
    const amb_real ratio = AMB_C(1.0) / amb_at_least(AMB_C(1.0) + gap, AMB_C(0.1));
    amb_stiffness k;
    const amb_real wider = amb_step_force(of->kf, of->magnet, f, i, ratio * s, &k);
    less = (sum - (ratio * ratio * (wider + of->iso->F_0[f]))) / gap;
  }
  return less / AMB_C(3.0);
}

void amb_row_signals(const samples *of, const amb_real *row, const apart *by,
                     amb_real signal[AMB_SIGNALS], amb_stiffness k[AMB_FORCES])
{
  const amb_isolation *iso = of->iso;
  const int forces = ROW_OF_FORCE * iso->forces;
  const int rest = (AMB_OF_SENSOR * iso->sensors) + iso->forms + (2 * iso->tones);
  signal[0] = AMB_C(1.0);
  for (int f = 0; f < iso->forces; f++) {
    const amb_real *from = row + (ROW_OF_FORCE * f);
    const amb_real i = from[0];
    const amb_real s = from[1] + by->s[f];
    amb_real *to = signal + 1 + (AMB_OF_FORCE * f);
    amb_stiffness changed;
    amb_stiffness late;
    to[0] = amb_step_force(of->kf, of->magnet, f, i, s, &k[f]);
    changed = k[f];
    if (amb_magnitude(by->half[f]) > AMB_C(0.0)) {
      (void)amb_step_force(of->kf, of->magnet, f, i + (by->half[f] * i), s, &changed);
    }
    to[1] = changed.k_i * i;
    to[2] = by_gap(of, f, i, s, to[0], k[f].k_s, by->gap[f]);
    to[3] = amb_step_force(of->kf, of->magnet, f, from[2], s, &late) - to[0];
    to[4] = both_coils(iso->bias[f], i, to[0], k[f].k_i);
  }
  amb_copy(rest, row + forces, signal + 1 + (AMB_OF_FORCE * iso->forces));
}

/* Signals of the sensors are those of the prediction, not of the updated mean. */
static void put_measurements(const amb_isolation *iso, amb_isolation_state *state,
                             const amb_kalman_state *filter, const amb_kalman_result *result,
                             amb_real *signal, amb_real *measured)
{
  for (int r = 0; r < iso->sensors; r++) {
    const bool missing = (result->health[r] & MISSING) != 0U;
    const amb_real e = missing ? AMB_C(0.0) : result->innovation[r];
    const amb_real last = state->read[r];
    const amb_real predicted = missing ? last : (filter->sensor[r].last_y - e);
    const amb_real *lag = iso->lag + (2 * r);
    signal[AMB_OF_SENSOR * r] = predicted;
    state->read[r] = predicted;
    state->lagged[r] += (lag[0] * (last - state->lagged[r])) + (lag[1] * (predicted - last));
    signal[(AMB_OF_SENSOR * r) + 1] = state->lagged[r] - predicted;
    measured[2 * r] = e;
    measured[(2 * r) + 1] = missing ? AMB_C(0.0) : result->variance[r];
  }
}

/* Gains of the sensors, which are taken in one after another, from the covariance after the last:
 * before a sensor the covariance is larger by K K' S. */
static void put_gains(const amb_isolation *iso, const amb_kalman *kf,
                      const amb_kalman_state *filter, const amb_kalman_result *result,
                      amb_real *gains)
{
  const int n = iso->states;
  for (int r = iso->sensors - 1; r >= 0; r--) {
    const amb_real R = amb_step_noise(kf, r, filter->mean) + kf->rounding[r];
    amb_real *K = gains + (r * n);
    amb_real with_y[AMB_STATES];
    amb_model_shown_with(&kf->model, r, filter->cov, with_y);
    for (int i = 0; i < n; i++) {
      K[i] = with_y[i] / iso->unit[i];
    }
    for (int q = r + 1; q < iso->sensors; q++) {
      const amb_real *later = gains + (q * n);
      const amb_real share = result->variance[q] * dot(n, iso->H + (r * n), later);
      for (int i = 0; i < n; i++) {
        K[i] += share * later[i];
      }
    }
    const bool used = (result->health[r] & (MISSING | AMB_OUTLIER)) == 0U;
    for (int i = 0; i < n; i++) {
      K[i] = !used ? AMB_C(0.0) : ((iso->K != NULL) ? iso->K[(r * n) + i] : (K[i] / R));
    }
  }
}

/* Rotate a cosine and a sine by an angle; `to` may be `from`. */
static void rotate_tone(const amb_real from[2], amb_real cosine, amb_real sine, amb_real to[2])
{
  const amb_real real = (from[0] * cosine) - (from[1] * sine);
  const amb_real imaginary = (from[1] * cosine) + (from[0] * sine);
  const amb_real longer = AMB_C(1.5) - (AMB_C(0.5) * ((real * real) + (imaginary * imaginary)));
  to[0] = real * longer; /* so rounding does not add up in the length */
  to[1] = imaginary * longer;
}

/* Cosine and sine of the tones, advanced from the row before; the last one by `more` [rad] in
 * addition, by the first terms of both series. */
static void put_tones(const amb_isolation *iso, const amb_real *before, amb_real more,
                      amb_real *tone)
{
  static const amb_real zero_angle[2] = {AMB_C(1.0), AMB_C(0.0)};
  for (int k = 0; k < iso->tones; k++) {
    const amb_real *by = iso->turn + (2 * k);
    rotate_tone((before == NULL) ? zero_angle : (before + (2 * k)), by[0], by[1], tone + (2 * k));
  }
  if (amb_magnitude(more) > AMB_C(0.0)) {
    const amb_real a = amb_clamp(more, AMB_C(-1.0), AMB_C(1.0));
    const amb_real q = a * a;
    amb_real *last = tone + (2 * (iso->tones - 1));
    rotate_tone(last, AMB_C(1.0) - ((AMB_C(0.5) * q) * (AMB_C(1.0) - (q / AMB_C(12.0)))),
                a * (AMB_C(1.0) - ((q / AMB_C(6.0)) * (AMB_C(1.0) - (q / AMB_C(20.0))))), last);
  }
}

/* Roughness: variance of the sums of e / sqrt(S) over blocks, relative to that of white
 * innovations. It is their spectral density at frequency 0, by which a load of c times the assumed
 * intensity multiplies it, and no other frequency by more; so l of any fault is at most c times as
 * large. */
static void put_roughness(const amb_isolation *iso, amb_isolation_state *state,
                          const amb_real measured[])
{
  const int length = iso->window / 4;
  for (int r = 0; r < iso->sensors; r++) {
    const amb_real S = measured[(2 * r) + 1];
    state->recent[0][r] += (S > AMB_C(0.0)) ? (measured[2 * r] / amb_root(S)) : AMB_C(0.0);
  }
  state->block++;
  if (state->block >= length) {
    const int known = START + ((state->blocks < 0) ? 0 : state->blocks);
    const amb_real *oldest = state->recent[AMB_ISOLATION_RECENT - 1];
    for (int r = 0; (state->blocks >= 0) && (r < iso->sensors); r++) {
      const amb_real before = state->roughness[r];
      const amb_real now = amb_at_most((oldest[r] * oldest[r]) / (amb_real)length, MOST * before);
      state->roughness[r] = before + ((now - before) / (amb_real)known);
    }
    state->blocks += (known < REMEMBERED) ? 1 : 0;
    for (int k = AMB_ISOLATION_RECENT - 1; k > 0; k--) {
      amb_copy(iso->sensors, state->recent[k - 1], state->recent[k]);
    }
    amb_clear(AMB_SENSORS, state->recent[0]);
    state->block = 0;
  }
}

static bool is_on_stop(const amb_isolation *iso, const amb_kalman *kf,
                       const amb_kalman_state *filter)
{
  bool on_stop = false;
  for (int r = 0; r < iso->sensors; r++) {
    const amb_real limit = ON_STOP * limit_of(kf, r);
    on_stop = on_stop || (amb_magnitude(filter->sensor[r].last_y) > limit);
  }
  return on_stop;
}

void amb_isolation_put(const amb_isolation *iso, amb_isolation_state *state, const amb_kalman *kf,
                       const amb_magnet magnet[AMB_FORCES], const amb_kalman_state *filter,
                       const amb_kalman_result *result, amb_real faster)
{
  const amb_real *mean = filter->mean;
  const int n = amb_states(&kf->model);
  const int rows = iso->window + iso->spare;
  const int size = amb_isolation_row(iso);
  const int sensors = ROW_OF_FORCE * iso->forces;
  const int forms = sensors + (AMB_OF_SENSOR * iso->sensors);
  const int tones = forms + iso->forms;
  const amb_real *before =
      (state->filled > 0) ? (state->ring + (state->newest * size) + tones) : NULL;
  state->newest = (state->newest + 1) % rows;
  amb_real *row = state->ring + (state->newest * size);
  amb_real *measured = row + tones + (2 * iso->tones);
  amb_real *gains = measured + (2 * iso->sensors);
  amb_real iu[AMB_CONTROLS];
  for (int c = 0; c < amb_controls(&kf->model); c++) {
    iu[c] = amb_clamp(kf->set.k_ui[c] * filter->last_u[c], kf->set.iu_min[c], kf->set.iu_max[c]);
  }
  bool lost = (result->status & AMB_BAD_VARIANCE) != 0U;
  put_forces(iso, state, kf, iu, row);
  put_measurements(iso, state, filter, result, row + sensors, measured);
  put_gains(iso, kf, filter, result, gains);
  if (state->apart || ((result->status & AMB_RESTARTED) != 0U)) {
    lost = !amb_restart_go_on(iso, state, kf, magnet, iu, filter, result, row) || lost;
    state->apart = state->apart && !lost;
    mean = state->apart ? state->mean : filter->mean;
  }
  put_roughness(iso, state, measured);
  const bool on_stop = is_on_stop(iso, kf, filter);
  const int apart = state->contact + ((state->contact < free_of(iso)) ? 1 : 0);
  state->contact = on_stop ? 0 : apart;
  for (int k = 0; k < iso->forms; k++) {
    row[forms + k] = dot(n, iso->form + (k * n), mean);
  }
  put_tones(iso, before, faster, row + tones);
  amb_copy(n, mean, state->mean);
  state->count++;
  if (lost || (state->seen < AMB_ISOLATION_LEAST)) {
    state->seen = lost ? 0 : (state->seen + 1); /* the late currents are not filled yet */
    state->filled = 1;
  } else {
    state->filled = (state->filled < rows) ? (state->filled + 1) : rows;
  }
}
