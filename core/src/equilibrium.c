#include "equilibrium.h"

/* State i at 1, the others at 0. */
static void only(const amb_model *model, int i, amb_real states[AMB_STATES])
{
  amb_clear(amb_states(model), states);
  states[i] = AMB_C(1.0);
}

void amb_rest_off_by_one(const amb_model *model, int i, amb_real states[AMB_STATES])
{
  only(model, i, states);
  if (amb_model_role(model, i) == AMB_POSITION) {
    amb_model_equilibrium(model, states);
  }
}

void amb_rest_where_shown(const amb_model *model, int r, amb_real states[AMB_STATES])
{
  const int n = amb_states(model);
  amb_real sum = AMB_C(0.0);
  amb_real one[AMB_STATES];
  amb_clear(n, states);
  for (int i = 0; i < n; i++) {
    if (amb_model_role(model, i) == AMB_POSITION) {
      amb_rest_off_by_one(model, i, one);
      const amb_real shown = amb_model_shown(model, r, one);
      sum += shown * shown;
      for (int j = 0; j < n; j++) {
        states[j] += shown * one[j];
      }
    }
  }
  for (int j = 0; j < n; j++) {
    states[j] = (sum > AMB_C(0.0)) ? (states[j] / sum) : AMB_C(0.0);
  }
}

bool amb_rest_sees(const amb_model *model, int r, const bool these[AMB_STATES])
{
  amb_real one[AMB_STATES];
  bool seen = false;
  for (int i = 0; i < amb_states(model); i++) {
    only(model, i, one);
    seen = seen || (these[i] && (amb_magnitude(amb_model_shown(model, r, one)) > AMB_C(0.0)));
  }
  return seen;
}

/* The position that velocity j moves most within a sample; the first one if there is none. */
static int moved_by(const amb_model *model, int j)
{
  const amb_real iu[AMB_CONTROLS] = {0};
  const amb_real F[AMB_FORCES] = {0};
  amb_real states[AMB_STATES];
  int most = -1;
  amb_real farthest = AMB_C(-1.0);
  only(model, j, states);
  amb_model_predict_mean(model, F, iu, states);
  for (int i = 0; i < amb_states(model); i++) {
    const amb_real far = amb_magnitude(states[i]);
    if ((amb_model_role(model, i) == AMB_POSITION) && (far > farthest)) {
      most = i;
      farthest = far;
    }
  }
  return most;
}

void amb_rest_add_followers(const amb_model *model, bool these[AMB_STATES])
{
  const int n = amb_states(model);
  amb_real one[AMB_STATES];
  for (int i = 0; i < n; i++) {
    if (amb_model_role(model, i) == AMB_VELOCITY) {
      const int position = moved_by(model, i);
      these[i] = these[i] || ((position >= 0) && these[position]);
    }
  }
  for (int i = 0; i < n; i++) {
    if (these[i] && (amb_model_role(model, i) == AMB_POSITION)) {
      amb_rest_off_by_one(model, i, one);
      for (int j = 0; j < n; j++) {
        these[j] = these[j] || ((amb_model_role(model, j) == AMB_SHOWN) &&
                                (amb_magnitude(one[j]) > AMB_C(0.0)));
      }
    }
  }
}
