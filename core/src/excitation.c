#include "ambkit/excitation.h"

void amb_excitation_reset(amb_excitation *e, amb_real f_d)
{
  const amb_recent none = {AMB_C(0.0), AMB_C(0.0)};
  for (int i = 0; i < AMB_AXIAL_STATES; i++) {
    e->slope[i] = AMB_C(0.0);
  }
  e->information = AMB_C(0.0);
  e->load = none;
  e->load.mean = f_d;
  e->answer = none;
  e->age = AMB_C(0.0);
  e->doubt = AMB_C(0.0);
}

void amb_excitation_miss(amb_excitation *e)
{
  e->information = AMB_C(0.0);
  e->age = (e->age > AMB_C(1.0)) ? (e->age - AMB_C(1.0)) : AMB_C(0.0);
}

bool amb_excitation_doubt(amb_excitation *e, const amb_excitation_settings *settings)
{
  const bool before = e->doubt >= AMB_DOUBTFUL_WINDOWS;
  /* The measurement that follows takes one of the two back. */
  const amb_real more = e->doubt + AMB_C(2.0) * settings->fresh;
  e->doubt = (more < AMB_DOUBT_WINDOWS) ? more : AMB_DOUBT_WINDOWS;
  return !before && (e->doubt >= AMB_DOUBTFUL_WINDOWS);
}

void amb_excitation_predict(amb_excitation *e, const amb_axial_model *model, amb_real k_s,
                            amb_real known)
{
  const amb_real s = amb_axial_displacement(model, e->slope);
  amb_axial_predict_mean(model, k_s * s + known, e->slope);
}

static void follow(amb_recent *recent, amb_real value, amb_real fresh)
{
  const amb_real off = value - recent->mean;
  recent->mean += fresh * off;
  recent->var += fresh * ((AMB_C(1.0) - fresh) * off * off - recent->var);
}

bool amb_excitation_update(amb_excitation *e, const amb_excitation_settings *settings,
                           const amb_real with_y[AMB_AXIAL_STATES], amb_real S,
                           const amb_real mean[AMB_AXIAL_STATES], amb_real x_max)
{
  const amb_real on_y = e->slope[AMB_AXIAL_STATES - 1];
  const amb_real per = on_y / S;
  for (int i = 0; i < AMB_AXIAL_STATES; i++) {
    e->slope[i] -= with_y[i] * per;
  }
  e->information += settings->fresh * (on_y * per - e->information);
  if (amb_magnitude(mean[0]) > (AMB_NEAR_STOP * x_max)) {
    e->information = AMB_C(0.0);
  }
  const amb_real slowly = settings->fresh / AMB_LOAD_WINDOWS;
  follow(&e->load, mean[2], slowly);
  follow(&e->answer, e->slope[2], slowly);
  const bool settled = e->age >= AMB_SETTLED_WINDOWS;
  if (!settled) {
    e->age += settings->fresh;
  }
  const bool doubtful = e->doubt >= AMB_DOUBTFUL_WINDOWS;
  const amb_real less = e->doubt - settings->fresh;
  e->doubt = (less > AMB_C(0.0)) ? less : AMB_C(0.0);
  const bool always = !(settings->least > AMB_C(0.0));
  return always || (settled && !doubtful && (e->information >= settings->least) &&
                    (e->load.var < (AMB_LOAD_SHARE * e->answer.var)));
}
