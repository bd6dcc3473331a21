#include "estimator_model.h"
#include "estimates.h"
#include "model.h"
#include <string.h>

amb_status amb_unit_tune(amb_unit *model, const double value[AMB_VARIABLES])
{
  return amb_filter_tune(&model->filter, value);
}

static void read(const double value[AMB_VARIABLES], amb_real y[AMB_SENSORS])
{
  for (int r = 0; r < AMB_SENSORS; r++)
    y[r] = (amb_real)value[FIRST_y + r];
}

/* In equilibrium at the first measurements. */
amb_status amb_unit_start(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_status status = amb_unit_tune(model, value);
  if (status != AMB_OK)
    return status;
  amb_real y[AMB_SENSORS], mean[AMB_STATES];
  read(value, y);
  amb_filter_shown(&model->filter, y, mean);
  amb_filter_start(&model->filter, &model->state, &model->result, mean);
  memset(model->last_u, 0, sizeof model->last_u);
  memset(model->bias, 0, sizeof model->bias);
  model->sampled = false;
  return AMB_OK;
}

#ifdef AMB_DATA_DEENERGISES
static bool power_fails(const double value[AMB_VARIABLES])
{
  return value[VR_power_failure] >= 0.5;
}
#else
static bool power_fails(const double value[AMB_VARIABLES])
{
  (void)value;
  return false;
}
#endif

/* The first sample has no time update. */
void amb_unit_sample(amb_unit *model, const double value[AMB_VARIABLES])
{
  const amb_estimator filter = amb_filter_estimator(&model->filter);
  amb_real y[AMB_SENSORS];
  read(value, y);
  (void)amb_estimator_step(&filter, &model->state, y, model->sampled ? model->last_u : NULL,
                           &model->result);
  amb_filter_carry(&model->filter, &model->state, &model->result, !model->sampled, model->bias);
  for (int c = 0; c < AMB_CONTROLS; c++)
    model->last_u[c] = (amb_real)value[FIRST_u + c];
  model->sampled = true;
  if (power_fails(value)) /* in the next time update */
    amb_deenergise(&filter, &model->state);
}

/* It reads its inputs at the start of a sample only. */
void amb_unit_part(amb_unit *model, double from, double to, const double value[AMB_VARIABLES])
{
  (void)to;
  if (!(from > 0))
    amb_unit_sample(model, value);
}

void amb_unit_show(const amb_unit *model, double value[AMB_VARIABLES])
{
  amb_estimates_show(&model->state, &model->result, model->bias, value);
}
