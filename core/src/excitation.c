#include "ambkit/excitation.h"
#include "kalman_step.h"

void amb_excitation_reset(amb_excitation *e, const amb_real mean[AMB_STATES])
{
  const amb_recent none = {AMB_C(0.0), AMB_C(0.0)};
  for (int i = 0; i < AMB_STATES; i++) {
    e->slope[i] = AMB_C(0.0);
    e->load[i] = none;
    e->load[i].mean = mean[i];
    e->answer[i] = none;
  }
  e->shared = AMB_C(0.0);
  e->offset = AMB_C(0.0);
  e->balanced = AMB_C(0.0);
  e->informative = false;
  e->sample_information = AMB_C(0.0);
  e->information = AMB_C(0.0);
  e->age = AMB_C(0.0);
  e->doubt = AMB_C(0.0);
}

void amb_excitation_miss(amb_excitation *e)
{
  e->sample_information = AMB_C(0.0);
  e->information = AMB_C(0.0);
  e->age = (e->age > AMB_C(1.0)) ? (e->age - AMB_C(1.0)) : AMB_C(0.0);
}

bool amb_excitation_doubt(amb_excitation *e, const amb_excitation_settings *settings)
{
  const bool before = e->doubt >= AMB_DOUBTFUL_WINDOWS;
  /* The following measurement update decrements it again. */
  e->doubt = amb_at_most(e->doubt + AMB_C(2.0) * settings->fresh, AMB_DOUBT_WINDOWS);
  return !before && (e->doubt >= AMB_DOUBTFUL_WINDOWS);
}

void amb_excitation_predict(amb_excitation *e, const amb_model *model,
                            const amb_stiffness k[AMB_FORCES], const amb_real known[AMB_FORCES])
{
  const amb_real none[AMB_CONTROLS] = {0};
  amb_step_carry(model, k, known, none, e->slope);
}

/* Restarts the statistics if one of them is not finite or far beyond its physical range. */
static void follow(amb_recent *recent, amb_real value, amb_real fresh, amb_real most)
{
  const amb_real widest = AMB_C(4.0) * most * most;
  if (AMB_WITHIN(value, most) && AMB_WITHIN(recent->mean, most) &&
      AMB_WITHIN(recent->var, widest)) {
    const amb_real off = value - recent->mean;
    recent->mean += fresh * off;
    recent->var += fresh * ((AMB_C(1.0) - fresh) * off * off - recent->var);
  } else {
    recent->mean = AMB_C(0.0);
    recent->var = AMB_C(0.0);
  }
}

void amb_excitation_hold(amb_excitation *e, const amb_kalman *kf)
{
  const int n = amb_states(&kf->model);
  for (int i = 0; i < n; i++) {
    if (!AMB_WITHIN(e->slope[i], AMB_BOUNDLESS * kf->set.cap[i])) {
      e->slope[i] = AMB_C(0.0);
      e->sample_information = AMB_C(0.0);
    }
  }
}

static bool near_a_stop(const amb_kalman *kf, const amb_real mean[AMB_STATES])
{
  bool near = false;
  for (int i = 0; i < amb_states(&kf->model); i++) {
    if (amb_model_role(&kf->model, i) == AMB_POSITION) {
      near = near || (amb_magnitude(mean[i]) > (AMB_NEAR_STOP * kf->set.cap[i]));
    }
  }
  return near;
}

void amb_excitation_update(amb_excitation *e, const amb_model *model, int r,
                           const amb_real with_y[AMB_STATES], amb_real S)
{
  const amb_real on_y = amb_model_shown(model, r, e->slope);
  const amb_real per = on_y / S;
  for (int i = 0; i < amb_states(model); i++) {
    e->slope[i] -= with_y[i] * per;
  }
  e->sample_information += on_y * per;
}

/* Slope of a regression, 0 on what does not vary. */
static amb_real regression(amb_real shared, amb_real variance)
{
  /* Of such a variance no quotient overflows. */
  return (variance > (AMB_C(4.0) / AMB_REAL_ROOT))
             ? amb_clamp(shared / variance, -AMB_REAL_ROOT, AMB_REAL_ROOT)
             : AMB_C(0.0);
}

/* Whether the magnet forces vary more than the disturbances, including this sample. */
static bool moves_more(amb_excitation *e, const amb_kalman *kf, amb_real slowly,
                       const amb_real mean[AMB_STATES])
{
  const amb_model *model = &kf->model;
  amb_real load = AMB_C(0.0);
  amb_real answer = AMB_C(0.0);
  amb_real product = AMB_C(0.0);
  for (int i = 0; i < amb_states(model); i++) {
    if (amb_model_role(model, i) == AMB_LOAD) {
      const amb_real most = AMB_BOUNDLESS * kf->set.cap[i];
      product += (mean[i] - e->load[i].mean) * (e->slope[i] - e->answer[i].mean);
      follow(&e->load[i], mean[i], slowly, most);
      follow(&e->answer[i], e->slope[i], slowly, most);
      load += e->load[i].var;
      answer += e->answer[i].var;
    }
  }
  const amb_real shared = e->shared + slowly * ((AMB_C(1.0) - slowly) * product - e->shared);
  e->shared = AMB_WITHIN(shared, AMB_REAL_ROOT) ? shared : AMB_C(0.0);
  e->offset = -regression(e->shared, answer);
  e->balanced = regression(e->shared, load);
  return load < (AMB_LOAD_SHARE * answer);
}

bool amb_excitation_learns(amb_excitation *e, const amb_excitation_settings *settings,
                           const amb_kalman *kf, const amb_real mean[AMB_STATES])
{
  const amb_real before = AMB_WITHIN(e->information, AMB_REAL_ROOT) ? e->information : AMB_C(0.0);
  e->information = before + settings->fresh * (e->sample_information - before);
  e->sample_information = AMB_C(0.0);
  if (near_a_stop(kf, mean)) {
    e->information = AMB_C(0.0);
  }
  const bool moved = moves_more(e, kf, settings->fresh / AMB_LOAD_WINDOWS, mean);
  const bool settled = e->age >= AMB_SETTLED_WINDOWS;
  if (!settled) {
    e->age += settings->fresh;
  }
  const bool doubtful = e->doubt >= AMB_DOUBTFUL_WINDOWS;
  e->doubt = amb_at_least(e->doubt - settings->fresh, AMB_C(0.0));
  const bool always = !(settings->least > AMB_C(0.0));
  e->informative = settled && !doubtful && (e->information >= settings->least);
  return always || (e->informative && moved);
}
