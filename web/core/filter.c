/* Filters of a machine, with default settings derived from it (sim/settings.h). */
#include "ambkit/phi.h"
#include "bench.h"
#include <math.h>

static bench_expert known_expert;

EXPORT(expert) double *expert(void)
{
  return (double *)&known_expert;
}

/* The filter's model of its magnets. */
static void set_magnets(const bench_known *known, int kind, bench_filter *filter)
{
  const bench_expert *e = &known_expert;
  for (int f = 0; f < known->view.axes; f++) {
    filter->law[f] = known->law[f];
    filter->constant[f] = amb_law_magnet.tangent(&known->law[f], 0.0, 0.0);
    filter->magnet[f] = (amb_magnet){&amb_law_magnet, &filter->law[f]};
    if ((kind == LINEAR) || (kind == LOW_PASS))
      filter->magnet[f] = (amb_magnet){&amb_constant_magnet, &filter->constant[f]};
  }
  if (kind != ADAPTIVE)
    return;
  filter->fuzzy = (amb_fuzzy){.rules = (int)e->rules,
                              .normalised = e->normalised > 0,
                              .per_ampere = e->per_ampere,
                              .per_metre = e->per_metre,
                              .iu_min = e->iu_min,
                              .iu_max = e->iu_max,
                              .x_min = e->x_min,
                              .x_max = e->x_max,
                              .centre_iu = e->centre_iu,
                              .centre_x = e->centre_x,
                              .k_i = {e->sharpness_k_i, e->weight_k_i},
                              .k_s = {e->sharpness_k_s, e->weight_k_s}};
  filter->magnet[0] = (amb_magnet){&amb_fuzzy_magnet, &filter->fuzzy};
  if ((known->scale < 1) || (known->scale > 1)) {
    filter->scaled = (amb_scaled){filter->magnet[0], known->scale};
    filter->magnet[0] = (amb_magnet){&amb_scaled_magnet, &filter->scaled};
  }
}

/* The machine with the filter's magnet model. */
static amb_view view_of(const bench_known *known, const bench_filter *filter, double k_i[],
                        double stiffness[])
{
  amb_view view = known->view;
  for (int f = 0; f < view.axes; f++) {
    k_i[f] = filter->constant[f].k_i;
    stiffness[f] = amb_magnitude(filter->constant[f].k_s);
  }
  view.k_i = k_i;
  view.stiffness = stiffness;
  return view;
}

static amb_kalman_settings settings_of(const bench_known *known, const bench_model *model,
                                       const amb_view *view)
{
  const int p = view->axes, m = view->sensors;
  amb_kalman_settings set = {.T = view->T,
                             .dwell = amb_view_dwell(view),
                             .gate = model->gate,
                             .frozen_limit = model->frozen_limit,
                             .outlier_limit = model->outlier_limit};
  amb_copy(m, view->K_sen, set.K_sen);
  amb_copy(m, known->lag, set.lag);
  amb_copy(m, view->range, set.travel);
  amb_copy(m, view->step, set.step);
  amb_copy(p, view->k_ui, set.k_ui);
  amb_copy(p, known->iu_min, set.iu_min);
  amb_copy(p, known->iu_max, set.iu_max);
  amb_copy(p, known->f_0, set.f_0);
  amb_copy(p, view->clearance, set.x_max);
  amb_copy(p, view->var_u, set.var_u);
  for (int f = 0; f < p; f++)
    set.var_d[f] =
        view->T * (known->Q > 0 ? known->Q : known->Q_times * amb_view_intensity(view, f));
  amb_copy(model->model.noises - model->loads, model->others, set.var_d + model->loads);
  for (int r = 0; r < m; r++)
    set.var_y[r] = known->R > 0 ? known->R : known->R_times * view->var_y[r];
  amb_view_caps(view, &model->states, set.cap);
  return set;
}

/* 1 - exp(-w T) of a corner w. */
static double share(double w, double T)
{
  return w * T * amb_phi1(w * T);
}

static void set_low_pass(const amb_view *view, bench_filter *filter)
{
  double corner[3];
  const amb_kalman_settings *set = &filter->kf.set;
  amb_view_corners(view, set->var_y[0], set->var_d[0] / view->T, corner);
  filter->low_pass.m = view->mass[0];
  filter->low_pass.position = share(corner[0], view->T);
  filter->low_pass.velocity = share(corner[1], view->T);
  filter->low_pass.force = share(corner[2], view->T);
}

bool bench_filter_of(const bench_known *known, const bench_model *model, int kind,
                     bench_filter *filter)
{
  static const amb_estimator_methods *const methods[KINDS] = {
      &amb_kalman_methods, &amb_kalman_methods,   &amb_extended_methods, &amb_unscented_methods,
      &amb_ud_methods,     &amb_low_pass_methods, &amb_kalman_methods};
  double k_i[WIDE], stiffness[WIDE];
  if ((model == NULL) || (kind < 0) || (kind >= KINDS) ||
      ((kind == ADAPTIVE) && !(known_expert.rules > 0)))
    return false;
  set_magnets(known, kind, filter);
  const amb_view view = view_of(known, filter, k_i, stiffness);
  const amb_kalman_settings set = settings_of(known, model, &view);
  filter->unscented = (amb_unscented){.reach = sqrt(3.0), .curvature = 2.0};
  filter->estimator =
      (amb_estimator){.methods = methods[kind], .kf = &filter->kf, .magnet = filter->magnet};
  if (kind == UNSCENTED)
    filter->estimator.own = &filter->unscented;
  if (kind == LOW_PASS)
    filter->estimator.own = &filter->low_pass;
  if (amb_kalman_init(&filter->kf, &model->model, &set) != AMB_OK)
    return false;
  if (kind == LOW_PASS)
    set_low_pass(&view, filter);
  filter->states = model->states;
  amb_view_start(&view, &model->states, filter->kf.set.var_y, filter->std);
  return true;
}

void bench_start(bench_filter *filter, const amb_real mean[])
{
  (void)filter->estimator.methods->reset(&filter->estimator, &filter->state, mean, filter->std);
}
