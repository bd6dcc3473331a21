#include "estimator.h"

extern "C" {
#include "ambkit/adaptive_noise.h"
#include "ambkit/low_pass.h"
#include "ambkit/observer.h"
#include "ambkit/smoother.h"
#include "ambkit/square_root.h"
#include "ambkit/unscented.h"
}

namespace
{

// Each setting by its name; all must be there, and no other.
amb_kalman_settings settings_of(const nb::kwargs &given)
{
  amb_kalman_settings s{};
  size_t known = 0;
  const auto take = [&](const char *name, auto &field) {
    if (!given.contains(name))
      throw std::invalid_argument(std::string("the setting ") + name + " is missing");
    field = nb::cast<std::remove_reference_t<decltype(field)>>(given[name]);
    known++;
  };
  take("T", s.T);
  take("m", s.m);
  take("K_sen", s.K_sen);
  take("T_sen", s.T_sen);
  take("k_ui", s.k_ui);
  take("f_0", s.f_0);
  take("iu_min", s.iu_min);
  take("iu_max", s.iu_max);
  take("x_max", s.x_max);
  take("var_u", s.var_u);
  take("var_d", s.var_d);
  take("var_y", s.var_y);
  take("gate", s.gate);
  take("frozen_limit", s.frozen_limit);
  take("outlier_limit", s.outlier_limit);
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

namespace
{

struct Kalman : Estimator {
  Kalman(nb::object asked, nb::kwargs settings) : Estimator(amb_kalman_methods, asked, settings)
  {
  }
};

struct Extended : Estimator {
  Extended(nb::object asked, nb::kwargs settings) : Estimator(amb_extended_methods, asked, settings)
  {
  }
};

struct SquareRoot : Estimator {
  SquareRoot(nb::object asked, nb::kwargs settings)
      : Estimator(amb_square_root_methods, asked, settings)
  {
  }
  nb::object factor()
  {
    const auto &s = *static_cast<const amb_square_root_state *>(state());
    const size_t n = AMB_AXIAL_STATES;
    return nb::make_tuple(shown({&s.U[0][0], &s.U[0][0] + n * n}, {n, n}),
                          shown({s.D, s.D + n}, {n}));
  }
};

struct Observer : Estimator {
  amb_observer own{};
  Observer(nb::object asked, const Vector &gain, const Vector &cov, amb_real variance,
           nb::kwargs settings)
      : Estimator(amb_observer_methods, asked, settings)
  {
    same_length(AMB_AXIAL_STATES, gain.size(), "gain");
    same_length(AMB_AXIAL_TRIANGLE, cov.size(), "cov");
    std::copy_n(gain.data(), AMB_AXIAL_STATES, own.gain);
    std::copy_n(cov.data(), AMB_AXIAL_TRIANGLE, own.cov);
    own.variance = variance;
    estimator.own = &own;
  }
  nb::dict more() const override
  {
    nb::dict d;
    d["gain"] = shown({own.gain, own.gain + AMB_AXIAL_STATES}, {AMB_AXIAL_STATES});
    d["cov"] = shown({own.cov, own.cov + AMB_AXIAL_TRIANGLE}, {AMB_AXIAL_TRIANGLE});
    d["variance"] = own.variance;
    return d;
  }
};

struct LowPass : Estimator {
  amb_low_pass own;
  LowPass(nb::object asked, amb_real position, amb_real velocity, amb_real force,
          nb::kwargs settings)
      : Estimator(amb_low_pass_methods, asked, settings), own{position, velocity, force}
  {
    estimator.own = &own;
  }
  nb::dict more() const override
  {
    nb::dict d;
    d["position"] = own.position;
    d["velocity"] = own.velocity;
    d["force"] = own.force;
    return d;
  }
};

struct Unscented : Estimator {
  amb_unscented own;
  Unscented(nb::object asked, amb_real reach, amb_real curvature, nb::kwargs settings)
      : Estimator(amb_unscented_methods, asked, settings), own{reach, curvature}
  {
    estimator.own = &own;
  }
  nb::dict more() const override
  {
    nb::dict d;
    d["reach"] = own.reach;
    d["curvature"] = own.curvature;
    return d;
  }
};

struct AdaptiveNoise : Estimator {
  amb_adaptive_noise own;
  AdaptiveNoise(nb::object around, bool measurement, bool disturbance, amb_real share,
                amb_real first_share, amb_real most, unsigned int window)
      : Estimator(nb::cast<const Estimator &>(around).scales() ? amb_adaptive_noise_scale_methods
                                                               : amb_adaptive_noise_methods,
                  around),
        own{nb::cast<const Estimator &>(around).estimator,
            measurement,
            disturbance,
            share,
            first_share,
            most,
            window}
  {
    if (amb_adaptive_noise_check(&own) != AMB_OK)
      throw std::invalid_argument("a parameter of the adaptation is outside its range");
    estimator.own = &own;
  }
  nb::dict more() const override
  {
    nb::dict d;
    d["measurement"] = own.measurement;
    d["disturbance"] = own.disturbance;
    d["share"] = own.share;
    d["first_share"] = own.first_share;
    d["most"] = own.most;
    d["window"] = own.window;
    return d;
  }
  nb::object noise()
  {
    const auto &s = *static_cast<const amb_adaptive_noise_state *>(state());
    return nb::make_tuple(s.kf.set.var_y, s.kf.set.var_d);
  }
};

void reset(Estimator &self, const Vector &mean, const Vector &std)
{
  same_length(AMB_AXIAL_STATES, mean.size(), "mean");
  same_length(AMB_AXIAL_STATES, std.size(), "std");
  if (self.estimator.methods->reset(&self.estimator, self.state(), mean.data(), std.data()) !=
      AMB_OK)
    throw std::invalid_argument("mean must be finite, std finite and positive");
  self.result = amb_kalman_result{};
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

Named run_input(Estimator &self, const amb_kalman_input &input, bool covariance)
{
  History history(input.n, covariance, self.scales());
  nb::gil_scoped_release release;
  amb_estimator_run(&self.estimator, self.state(), &input, &history.to);
  return history.arrays;
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

Named run_kalman(Kalman &self, const Vector &y, const Vector &u, std::optional<Vector> k_i,
                 std::optional<Vector> k_s, bool covariance)
{
  const size_t n = y.size();
  same_length(n, u.size(), "u");
  if (k_i.has_value() != k_s.has_value())
    throw std::invalid_argument("k_i and k_s are given together or not at all");
  if (k_i) {
    same_length(n, k_i->size(), "k_i");
    same_length(n, k_s->size(), "k_s");
  }
  return run_input(
      self, {n, y.data(), u.data(), k_i ? k_i->data() : nullptr, k_s ? k_s->data() : nullptr},
      covariance);
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
  const amb_kalman_settings &s = self.kf.set;
  const amb_axial_model &m = self.kf.model;
  nb::dict set, model, all;
  set["T"] = s.T;
  set["m"] = s.m;
  set["K_sen"] = s.K_sen;
  set["T_sen"] = s.T_sen;
  set["k_ui"] = s.k_ui;
  set["f_0"] = s.f_0;
  set["iu_min"] = s.iu_min;
  set["iu_max"] = s.iu_max;
  set["x_max"] = s.x_max;
  set["var_u"] = s.var_u;
  set["var_d"] = s.var_d;
  set["var_y"] = s.var_y;
  set["gate"] = s.gate;
  set["frozen_limit"] = s.frozen_limit;
  set["outlier_limit"] = s.outlier_limit;
  model["T"] = m.T;
  model["T_m"] = m.T_m;
  model["T2_2m"] = m.T2_2m;
  model["a_sen"] = m.a_sen;
  model["b_sen"] = m.b_sen;
  all["set"] = set;
  all["model"] = model;
  all["far_squared"] = self.kf.far_squared;
  all["gate_squared"] = self.kf.gate_squared;
  all["widest"] = self.kf.widest;
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
}

} // namespace

void bind_estimators(nb::module_ &m)
{
  bind_flags(m);
  nb::class_<Estimator>(m, "Estimator", "One of the family (ambkit/estimator.h).")
      .def("reset", &reset, nb::arg("mean"), nb::arg("std"),
           "Start from a mean (4,) and standard deviations (4,), uncorrelated.")
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
      .def_prop_ro("status", [](const Estimator &s) { return s.result.status; })
      .def_prop_ro("innovation", [](const Estimator &s) { return s.result.innovation; })
      .def_prop_ro("variance", [](const Estimator &s) { return s.result.variance; })
      .def_prop_ro("k_i", [](const Estimator &s) { return s.result.stiffness.k_i; })
      .def_prop_ro("k_s", [](const Estimator &s) { return s.result.stiffness.k_s; });
  nb::class_<Kalman, Estimator>(m, "Kalman", "Kalman filter (paper, eq. 7-21, Fig. 8).")
      .def(nb::init<nb::object, nb::kwargs>(), nb::arg("magnet"), nb::arg("settings"),
           nb::sig("def __init__(self, magnet: Magnet, **settings: float) -> None"))
      .def("run", &run_kalman, nb::arg("y"), nb::arg("u"), nb::arg("k_i") = nb::none(),
           nb::arg("k_s") = nb::none(), nb::kw_only(), nb::arg("covariance") = false,
           "A whole record, with given stiffnesses (n,) or the magnet's.");
  nb::class_<Extended, Estimator>(m, "Extended", "Extended Kalman filter.")
      .def(nb::init<nb::object, nb::kwargs>(), nb::arg("magnet"), nb::arg("settings"),
           nb::sig("def __init__(self, magnet: Magnet, **settings: float) -> None"));
  nb::class_<SquareRoot, Estimator>(m, "SquareRoot", "Extended filter (ambkit/square_root.h).")
      .def(nb::init<nb::object, nb::kwargs>(), nb::arg("magnet"), nb::arg("settings"),
           nb::sig("def __init__(self, magnet: Magnet, **settings: float) -> None"))
      .def_prop_ro("factor", &SquareRoot::factor, "U (4, 4) and D (4,) of the covariance U D U'.");
  nb::class_<Unscented, Estimator>(m, "Unscented", "Unscented filter (ambkit/unscented.h).")
      .def(nb::init<nb::object, amb_real, amb_real, nb::kwargs>(), nb::arg("magnet"),
           nb::arg("reach"), nb::arg("curvature"), nb::arg("settings"),
           nb::sig("def __init__(self, magnet: Magnet, reach: float, curvature: float, "
                   "**settings: float) -> None"));
  nb::class_<AdaptiveNoise, Estimator>(m, "AdaptiveNoise",
                                       "Noise found online (ambkit/adaptive_noise.h).")
      .def(nb::init<nb::object, bool, bool, amb_real, amb_real, amb_real, unsigned int>(),
           nb::arg("around"), nb::kw_only(), nb::arg("measurement"), nb::arg("disturbance"),
           nb::arg("share"), nb::arg("first_share"), nb::arg("most"), nb::arg("window"),
           nb::sig("def __init__(self, around: Estimator, *, measurement: bool, disturbance: bool, "
                   "share: float, first_share: float, most: float, window: int) -> None"))
      .def_prop_ro("noise", &AdaptiveNoise::noise,
                   "var_y [m^2] and var_d [N^2 a sample] as found so far.");
  nb::class_<Observer, Estimator>(m, "Observer", "Constant gain (ambkit/observer.h).")
      .def(nb::init<nb::object, const Vector &, const Vector &, amb_real, nb::kwargs>(),
           nb::arg("magnet"), nb::arg("gain"), nb::arg("cov"), nb::arg("variance"),
           nb::arg("settings"),
           nb::sig("def __init__(self, magnet: Magnet, gain: NDArray[Any], cov: NDArray[Any], "
                   "variance: float, **settings: float) -> None"));
  nb::class_<LowPass, Estimator>(m, "LowPass", "Low-pass filters (ambkit/low_pass.h).")
      .def(nb::init<nb::object, amb_real, amb_real, amb_real, nb::kwargs>(), nb::arg("magnet"),
           nb::arg("position"), nb::arg("velocity"), nb::arg("force"), nb::arg("settings"),
           nb::sig("def __init__(self, magnet: Magnet, position: float, velocity: float, "
                   "force: float, **settings: float) -> None"));
}
