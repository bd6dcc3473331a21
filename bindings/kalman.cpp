#include "kalman.h"

#include <algorithm>

namespace
{

void init(Kalman *self, nb::object magnet, amb_real T, amb_real m, amb_real K_sen, amb_real T_sen,
          amb_real k_ui, amb_real f_0, amb_real iu_min, amb_real iu_max, amb_real x_max,
          amb_real var_u, amb_real var_d, amb_real var_y, unsigned frozen_limit)
{
  new (self) Kalman{};
  const amb_kalman_settings s{T,      m,     K_sen, T_sen, k_ui,  f_0,         iu_min,
                              iu_max, x_max, var_u, var_d, var_y, frozen_limit};
  if (amb_kalman_init(&self->kf, &s) != AMB_OK)
    throw std::invalid_argument("a setting of the Kalman filter is outside its range");
  self->magnet = nb::cast<const Magnet &>(magnet).magnet;
  self->keeps = magnet;
}

void reset(Kalman &self, const Vector &mean, const Vector &std)
{
  same_length(AMB_AXIAL_STATES, mean.size(), "mean");
  same_length(AMB_AXIAL_STATES, std.size(), "std");
  if (amb_kalman_reset(&self.state, mean.data(), std.data()) != AMB_OK)
    throw std::invalid_argument("mean must be finite, std finite and positive");
  self.result = amb_kalman_result{};
}

amb_status predict(Kalman &self, amb_real u)
{
  amb_status status = AMB_OK;
  const amb_real iu = amb_kalman_current(&self.kf, &self.state, u, &status);
  const amb_stiffness k = amb_kalman_stiffness(&self.kf, &self.magnet, iu, self.state.mean[0]);
  self.result.stiffness = k;
  return self.result.status = status | amb_kalman_predict(&self.kf, &self.state, k, iu);
}

amb_status update(Kalman &self, amb_real y)
{
  return self.result.status = amb_kalman_update(&self.kf, &self.state, y, &self.result);
}

amb_status step(Kalman &self, amb_real y, amb_real u)
{
  return amb_kalman_step(&self.kf, &self.magnet, &self.state, y, u, &self.result);
}

Named run(Kalman &self, const Vector &y, const Vector &u, std::optional<Vector> k_i,
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
  const amb_kalman_input input{n, y.data(), u.data(), k_i ? k_i->data() : nullptr,
                               k_s ? k_s->data() : nullptr};
  History history(n, covariance);
  {
    nb::gil_scoped_release release;
    amb_kalman_run(&self.kf, &self.magnet, &self.state, &input, &history.to);
  }
  return history.arrays;
}

Out<amb_real> forecast(const Kalman &self, const Matrix &mean, const Vector &u, size_t ahead)
{
  const size_t n = mean.shape(0);
  same_length(n, u.size(), "u");
  if (mean.shape(1) != AMB_AXIAL_STATES)
    throw std::invalid_argument("mean must have 4 columns");
  const size_t made = n > ahead ? n - ahead : 0;
  Fresh<amb_real> y({made});
  nb::gil_scoped_release release;
  for (size_t k = 0; k < made; k++)
    y.data[k] = amb_kalman_forecast(&self.kf, &self.magnet, mean.data() + k * AMB_AXIAL_STATES,
                                    u.data() + k, ahead);
  return y.array;
}

Out<amb_real> mean(const Kalman &self)
{
  Fresh<amb_real> a({AMB_AXIAL_STATES});
  std::copy_n(self.state.mean, AMB_AXIAL_STATES, a.data);
  return a.array;
}

Out<amb_real> covariance(const Kalman &self)
{
  const size_t n = AMB_AXIAL_STATES;
  Fresh<amb_real> P({n, n});
  const amb_real *entry = self.state.cov;
  for (size_t i = 0; i < n; i++)
    for (size_t j = i; j < n; j++)
      P.data[i * n + j] = P.data[j * n + i] = *entry++;
  return P.array;
}

Named parameters(const Kalman &self)
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
  set["frozen_limit"] = s.frozen_limit;
  model["T"] = m.T;
  model["T_m"] = m.T_m;
  model["T2_2m"] = m.T2_2m;
  model["a_sen"] = m.a_sen;
  model["b_sen"] = m.b_sen;
  all["set"] = set;
  all["model"] = model;
  all["far_squared"] = self.kf.far_squared;
  return all;
}

} // namespace

void bind_kalman(nb::module_ &m)
{
  nb::class_<Kalman>(m, "Kalman", "Kalman filter of one axial bearing (paper, eq. 7-21, Fig. 8).")
      .def("__init__", &init, nb::arg("magnet"), nb::kw_only(), nb::arg("T"), nb::arg("m"),
           nb::arg("K_sen"), nb::arg("T_sen"), nb::arg("k_ui"), nb::arg("f_0"), nb::arg("iu_min"),
           nb::arg("iu_max"), nb::arg("x_max"), nb::arg("var_u"), nb::arg("var_d"),
           nb::arg("var_y"), nb::arg("frozen_limit"))
      .def("reset", &reset, nb::arg("mean"), nb::arg("std"),
           "Start from a mean (4,) and standard deviations (4,), uncorrelated.")
      .def("predict", &predict, nb::arg("u"), "One sample on (eq. 9, 10); returns the status.")
      .def("update", &update, nb::arg("y"), "Take in y (eq. 11-13); returns the status.")
      .def("step", &step, nb::arg("y"), nb::arg("u"), "Predict with u, update with y.")
      .def("run", &run, nb::arg("y"), nb::arg("u"), nb::arg("k_i") = nb::none(),
           nb::arg("k_s") = nb::none(), nb::arg("covariance") = false,
           "A whole record; u[k] acts from sample k to k + 1.")
      .def("forecast", &forecast, nb::arg("mean"), nb::arg("u"), nb::arg("ahead"),
           "Measurement `ahead` samples after each of mean (n, 4), u (n,): (n - ahead,) [m].")
      .def_prop_ro("mean", &mean, nb::rv_policy::move,
                   "State estimate (4,): x [m], v [m/s], f_d [N], x_m [m].")
      .def_prop_ro("covariance", &covariance, nb::rv_policy::move, "Its covariance (4, 4).")
      .def_prop_ro("parameters", &parameters,
                   "Settings, and what was computed from them, by the names of their fields.")
      .def_prop_ro("status", [](const Kalman &s) { return s.result.status; })
      .def_prop_ro("innovation", [](const Kalman &s) { return s.result.innovation; })
      .def_prop_ro("variance", [](const Kalman &s) { return s.result.variance; })
      .def_prop_ro("k_i", [](const Kalman &s) { return s.result.stiffness.k_i; })
      .def_prop_ro("k_s", [](const Kalman &s) { return s.result.stiffness.k_s; });
  m.attr("OK") = AMB_OK;
  m.attr("MISSING") = AMB_MISSING;
  m.attr("FROZEN") = AMB_FROZEN;
  m.attr("SATURATED") = AMB_SATURATED;
  m.attr("BAD_CONTROL") = AMB_BAD_CONTROL;
  m.attr("BAD_VARIANCE") = AMB_BAD_VARIANCE;
  m.attr("HELD") = AMB_HELD;
  m.attr("BAD_PARAMETER") = AMB_BAD_PARAMETER;
  m.attr("UNEXCITED") = AMB_UNEXCITED;
}
