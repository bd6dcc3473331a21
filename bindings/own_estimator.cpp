// An estimator in Python: a function of y and u that returns the mean as a list of all states.
#include "estimator.h"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace
{

struct OwnState {
  amb_kalman_state base;
  amb_real u[AMB_CONTROLS]; // since the last sample; 0 after a reset
};

amb_status own_reset(const amb_estimator *self, void *state, const amb_real mean[AMB_STATES],
                     const amb_real std[AMB_STATES])
{
  auto &s = *static_cast<OwnState *>(state);
  const amb_status status = amb_kalman_reset(self->kf, &s.base, mean, std);
  if (status == AMB_OK) {
    std::fill(std::begin(s.u), std::end(s.u), amb_real{0});
    std::fill(std::begin(s.base.cov), std::end(s.base.cov), amb_real{0});
  }
  return status;
}

amb_status own_predict(const amb_estimator *self, void *state, const amb_real u[AMB_CONTROLS],
                       amb_kalman_result *result)
{
  auto &s = *static_cast<OwnState *>(state);
  std::copy_n(u, amb_controls(&self->kf->model), s.u);
  std::fill_n(result->stiffness, amb_forces(&self->kf->model), amb_stiffness{});
  result->status = AMB_OK;
  return AMB_OK;
}

amb_status own_update(const amb_estimator *self, void *state, const amb_real y[AMB_SENSORS],
                      amb_kalman_result *result)
{
  auto &s = *static_cast<OwnState *>(state);
  const amb_model &model = self->kf->model;
  result->status = AMB_OK;
  for (int r = 0; r < amb_sensors(&model); r++) {
    result->innovation[r] = result->variance[r] = 0;
    result->health[r] = std::isfinite(y[r]) ? AMB_OK : AMB_MISSING;
    result->status |= result->health[r];
  }
  nb::gil_scoped_acquire acquire;
  nb::list seen, acted;
  for (int r = 0; r < amb_sensors(&model); r++)
    seen.append(y[r]);
  for (int c = 0; c < amb_controls(&model); c++)
    acted.append(s.u[c]);
  // It raises no exception, and returns a number for each state (estimate/own.py).
  const nb::object mean = (*static_cast<const nb::callable *>(self->own))(seen, acted);
  for (int i = 0; i < amb_states(&model); i++)
    s.base.mean[i] = nb::cast<amb_real>(mean[i]);
  return result->status;
}

void own_advance(const amb_estimator *, amb_real, const amb_real *, amb_real *)
{
}

const amb_estimator_methods own_methods = {sizeof(OwnState), own_reset, own_predict, own_update,
                                           own_advance,      nullptr,   nullptr};

struct Own : Estimator {
  nb::callable answer;
  Own(nb::object magnet, nb::object model, nb::callable step, nb::kwargs settings)
      : Estimator(own_methods, magnet, model, settings), answer(step)
  {
    estimator.own = &answer;
  }
};

} // namespace

void bind_own(nb::module_ &m)
{
  nb::class_<Own, Estimator>(m, "Own", "An estimator in Python.")
      .def(nb::init<nb::object, nb::object, nb::callable, nb::kwargs>(), nb::arg("magnet"),
           nb::arg("model"), nb::arg("answer"), nb::arg("settings"),
           nb::sig("def __init__(self, magnet: Magnet | list[Magnet], model: Model, "
                   "answer: Any, **settings: Any) -> None"));
}
