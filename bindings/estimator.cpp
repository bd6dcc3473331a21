// What every estimator of the family can do, whichever it is.
#include "estimator.h"

extern "C" {
#include "ambkit/smoother.h"
#include "ambkit/square_root.h"
#include "ambkit/unscented.h"
#include "generated/axial_fields.h"
}

namespace
{

// Each setting with its name.
template <typename Settings, typename Visit> void each_setting(Settings &s, Visit visit)
{
  visit("T", s.T);
  visit("m", s.m);
  visit("K_sen", s.K_sen);
  visit("T_sen", s.T_sen);
  visit("k_ui", s.k_ui);
  visit("f_0", s.f_0);
  visit("iu_min", s.iu_min);
  visit("iu_max", s.iu_max);
  visit("x_max", s.x_max);
  visit("var_u", s.var_u);
  visit("var_d", s.var_d);
  visit("var_y", s.var_y);
  visit("gate", s.gate);
  visit("as_printed", s.as_printed);
  visit("frozen_limit", s.frozen_limit);
  visit("outlier_limit", s.outlier_limit);
}

// All must be there, and no other.
amb_kalman_settings settings_of(const nb::kwargs &given)
{
  amb_kalman_settings s{};
  size_t known = 0;
  each_setting(s, [&](const char *name, auto &field) {
    if (!given.contains(name))
      throw std::invalid_argument(std::string("the setting ") + name + " is missing");
    field = nb::cast<std::remove_reference_t<decltype(field)>>(given[name]);
    known++;
  });
  if (given.size() != known)
    throw std::invalid_argument("there is a setting that no estimator has");
  return s;
}

} // namespace

Estimator::Estimator(const amb_estimator_methods &methods, nb::object asked,
                     const nb::kwargs &settings)
    : keeps(asked), memory(methods.state_size / sizeof(std::max_align_t) + 1)
{
  const amb_kalman_settings s = settings_of(settings);
  if (amb_kalman_init(&kf, &s) != AMB_OK)
    throw std::invalid_argument("a setting of the estimator is outside its range");
  magnet = nb::cast<const Magnet &>(asked).magnet;
  estimator = {&methods, &kf, &magnet, nullptr};
}

Estimator::Estimator(const amb_estimator_methods &methods, nb::object around)
    : keeps(around), memory(methods.state_size / sizeof(std::max_align_t) + 1)
{
  const auto &inner = nb::cast<const Estimator &>(around);
  kf = inner.kf;
  magnet = inner.magnet;
  estimator = {&methods, &kf, &magnet, nullptr};
}

Named run_input(Estimator &self, const amb_kalman_input &input, bool covariance)
{
  History history(input.n, covariance, self.scales());
  nb::gil_scoped_release release;
  amb_estimator_run(&self.estimator, self.state(), &input, &history.to);
  return history.arrays;
}

namespace
{

void reset(Estimator &self, const Vector &mean, std::optional<Vector> std)
{
  same_length(AMB_AXIAL_STATES, mean.size(), "mean");
  if (std)
    same_length(AMB_AXIAL_STATES, std->size(), "std");
  if (self.estimator.methods->reset(&self.estimator, self.state(), mean.data(),
                                    std ? std->data() : nullptr) != AMB_OK)
    throw std::invalid_argument("mean must be finite, std finite and positive");
  self.result = amb_kalman_result{};
}

// Whether a kind keeps nothing that depends on its parameters: mean, covariance, counts only.
bool keeps_estimates_only(const Estimator &one)
{
  const amb_estimator_methods *kinds[] = {&amb_kalman_methods, &amb_extended_methods,
                                          &amb_unscented_methods};
  return std::find(std::begin(kinds), std::end(kinds), one.estimator.methods) != std::end(kinds);
}

void take_over(Estimator &self, const Estimator &other)
{
  const auto *kind = self.estimator.methods;
  const bool factors = kind == &amb_square_root_methods && kind == other.estimator.methods;
  if (!factors && !(keeps_estimates_only(self) && keeps_estimates_only(other)))
    throw std::invalid_argument("only linear, adaptive, extended and unscented Kalman filters can "
                                "take over from each other, and the square-root one from its own "
                                "kind");
  self.copy_state(other);
}

amb_status predict(Estimator &self, amb_real u)
{
  return self.estimator.methods->predict(&self.estimator, self.state(), u, &self.result);
}

amb_status update(Estimator &self, amb_real y)
{
  return self.estimator.methods->update(&self.estimator, self.state(), y, &self.result);
}

amb_status step(Estimator &self, amb_real y, amb_real u)
{
  return amb_estimator_step(&self.estimator, self.state(), y, u, &self.result);
}

Named run(Estimator &self, const Vector &y, const Vector &u, bool covariance)
{
  same_length(y.size(), u.size(), "u");
  return run_input(self, {y.size(), y.data(), u.data(), nullptr, nullptr}, covariance);
}

Named smooth(Estimator &self, const Vector &y, const Vector &u)
{
  same_length(y.size(), u.size(), "u");
  History history(y.size(), true, self.scales());
  const amb_kalman_input input{y.size(), y.data(), u.data(), nullptr, nullptr};
  nb::gil_scoped_release release;
  amb_estimator_run(&self.estimator, self.state(), &input, &history.to);
  amb_smooth(&self.kf, input.n, &history.to);
  return history.arrays;
}

Out<amb_real> forecast(const Estimator &self, const Matrix &mean, const Vector &u, size_t ahead,
                       std::optional<Vector> scale)
{
  const size_t n = mean.shape(0);
  same_length(n, u.size(), "u");
  if (scale)
    same_length(n, scale->size(), "scale");
  if (mean.shape(1) != AMB_AXIAL_STATES)
    throw std::invalid_argument("mean must have 4 columns");
  const size_t made = n > ahead ? n - ahead : 0;
  Fresh<amb_real> y({made});
  nb::gil_scoped_release release;
  for (size_t k = 0; k < made; k++)
    y.data[k] = amb_estimator_forecast(&self.estimator, scale ? scale->data()[k] : 1,
                                       mean.data() + k * AMB_AXIAL_STATES, u.data() + k, ahead);
  return y.array;
}

Out<amb_real> mean(const Estimator &self)
{
  Fresh<amb_real> a({AMB_AXIAL_STATES});
  std::copy_n(self.base().mean, AMB_AXIAL_STATES, a.data);
  return a.array;
}

// The state's own memory, so that a caller who steps sample by sample makes no array of his own.
nb::ndarray<nb::numpy, const amb_real> live(nb::handle_t<Estimator> self)
{
  return nb::ndarray<nb::numpy, const amb_real>(nb::cast<Estimator &>(self).base().mean,
                                                {AMB_AXIAL_STATES}, self);
}

Out<amb_real> covariance(const Estimator &self)
{
  const size_t n = AMB_AXIAL_STATES;
  Fresh<amb_real> P({n, n});
  const amb_real *entry = self.base().cov;
  for (size_t i = 0; i < n; i++)
    for (size_t j = i; j < n; j++)
      P.data[i * n + j] = P.data[j * n + i] = *entry++;
  return P.array;
}

nb::object scale(Estimator &self)
{
  if (!self.scales())
    return nb::none();
  amb_real value = 0, variance = 0;
  self.estimator.methods->scale(&self.estimator, self.state(), &value, &variance);
  return nb::make_tuple(value, variance);
}

Named parameters(const Estimator &self)
{
  const amb_axial_model &m = self.kf.model;
  nb::dict set, model, all;
  each_setting(self.kf.set, [&](const char *name, const auto &field) { set[name] = field; });
#define SHOW(field) model[#field] = m.field
  AMB_AXIAL_MODEL_FIELDS(SHOW);
#undef SHOW
  all["set"] = set;
  all["model"] = model;
  all["growth"] =
      shown({self.kf.growth, self.kf.growth + AMB_AXIAL_TRIANGLE}, {AMB_AXIAL_TRIANGLE});
  all["far_squared"] = self.kf.far_squared;
  all["gate_squared"] = self.kf.gate_squared;
  all["widest"] = self.kf.widest;
  all["cap"] = shown({self.kf.cap, self.kf.cap + AMB_AXIAL_STATES}, {AMB_AXIAL_STATES});
  return all;
}

void bind_flags(nb::module_ &m)
{
  m.attr("OK") = AMB_OK;
  m.attr("MISSING") = AMB_MISSING;
  m.attr("FROZEN") = AMB_FROZEN;
  m.attr("SATURATED") = AMB_SATURATED;
  m.attr("BAD_CONTROL") = AMB_BAD_CONTROL;
  m.attr("BAD_VARIANCE") = AMB_BAD_VARIANCE;
  m.attr("HELD") = AMB_HELD;
  m.attr("BAD_PARAMETER") = AMB_BAD_PARAMETER;
  m.attr("UNEXCITED") = AMB_UNEXCITED;
  m.attr("OUTLIER") = AMB_OUTLIER;
  m.attr("SURPRISED") = AMB_SURPRISED;
  m.attr("NOISE_LIMIT") = AMB_NOISE_LIMIT;
  m.attr("RESTARTED") = AMB_RESTARTED;
}

} // namespace

void bind_estimator(nb::module_ &m)
{
  bind_flags(m);
  nb::class_<Estimator>(m, "Estimator", "One of the family (ambkit/estimator.h).")
      .def("reset", &reset, nb::arg("mean"), nb::arg("std") = nb::none(),
           "Start from a mean (4,) and standard deviations (4,), uncorrelated; None: diffuse.")
      .def("take_over", &take_over, nb::arg("other"),
           "Go on where another is: its mean, covariance and counts.")
      .def("predict", &predict, nb::arg("u"), "One sample on; returns the status.")
      .def("update", &update, nb::arg("y"), "Take in y; returns the status.")
      .def("step", &step, nb::arg("y"), nb::arg("u"), "Predict with u, update with y.")
      .def("run", &run, nb::arg("y"), nb::arg("u"), nb::kw_only(), nb::arg("covariance") = false,
           "A whole record; u[k] acts from sample k to k + 1.")
      .def("smooth", &smooth, nb::arg("y"), nb::arg("u"),
           "A whole record, mean and covariance by all of it (ambkit/smoother.h).")
      .def("forecast", &forecast, nb::arg("mean"), nb::arg("u"), nb::arg("ahead"),
           nb::arg("scale") = nb::none(),
           "Measurement `ahead` samples after each of mean (n, 4), u (n,): (n - ahead,) [m].")
      .def_prop_ro("mean", &mean, nb::rv_policy::move,
                   "State estimate (4,): x [m], v [m/s], f_d [N], x_m [m].")
      .def_prop_ro("live_mean", &live, "The same, read only, which follows the estimator.")
      .def_prop_ro("covariance", &covariance, nb::rv_policy::move, "Its covariance (4, 4).")
      .def_prop_ro("scale", &scale,
                   "Scale of the magnet's force and its variance; None where not estimated.")
      .def_prop_ro("parameters", &parameters,
                   "Settings, and what was computed from them, by the names of their fields.")
      .def_prop_ro(
          "own", [](const Estimator &s) -> Named { return s.more(); },
          "What only this kind has, by the names of the fields.")
      .def_prop_rw(
          "state",
          [](Estimator &s) {
            return kept(
                {{s.state(), s.estimator.methods->state_size}, {&s.result, sizeof s.result}});
          },
          [](Estimator &s, const nb::bytes &from) {
            restore(from,
                    {{s.state(), s.estimator.methods->state_size}, {&s.result, sizeof s.result}});
          },
          "All that it knows, as bytes of this build, for an estimator that was made alike.")
      .def_prop_ro("status", [](const Estimator &s) { return s.result.status; })
      .def_prop_ro("innovation", [](const Estimator &s) { return s.result.innovation; })
      .def_prop_ro("variance", [](const Estimator &s) { return s.result.variance; })
      .def_prop_ro("k_i", [](const Estimator &s) { return s.result.stiffness.k_i; })
      .def_prop_ro("k_s", [](const Estimator &s) { return s.result.stiffness.k_s; });
}
