// Steps and runs of the estimators.
#include "estimator.h"
#include "work.h"

extern "C" {
#include "ambkit/smoother.h"
#include "batch.h"
}

Named run_input(Estimator &self, const amb_kalman_input &input, bool covariance,
                const std::optional<std::string> &instructions)
{
  const amb_instructions set = chosen(instructions);
  History history(input.n, self.sizes(), covariance, self.scales());
  {
    nb::gil_scoped_release release;
    amb_batch_one(set, &self.estimator, self.state(), &input, &history.to);
  }
  return history.arrays;
}

namespace
{

amb_status predict(Estimator &self, const Samples &u)
{
  same_length(1, samples_of(u, self.sizes().controls, "u"), "u");
  return self.result.status =
             self.estimator.methods->predict(&self.estimator, self.state(), u.data(), &self.result);
}

amb_status update(Estimator &self, const Samples &y)
{
  same_length(1, samples_of(y, self.sizes().sensors, "y"), "y");
  return self.result.status =
             self.estimator.methods->update(&self.estimator, self.state(), y.data(), &self.result);
}

amb_status step(Estimator &self, const Samples &y, const Samples &u)
{
  same_length(1, samples_of(y, self.sizes().sensors, "y"), "y");
  same_length(1, samples_of(u, self.sizes().controls, "u"), "u");
  return amb_estimator_step(&self.estimator, self.state(), y.data(), u.data(), &self.result);
}

// For one sensor and one control, without arrays.
void only_one(const Estimator &self)
{
  self.must_be_single("a step with numbers instead of arrays");
}

amb_status predict_one(Estimator &self, amb_real u)
{
  only_one(self);
  const amb_real all[AMB_CONTROLS] = {u};
  return self.result.status =
             self.estimator.methods->predict(&self.estimator, self.state(), all, &self.result);
}

amb_status update_one(Estimator &self, amb_real y)
{
  only_one(self);
  const amb_real all[AMB_SENSORS] = {y};
  return self.result.status =
             self.estimator.methods->update(&self.estimator, self.state(), all, &self.result);
}

amb_status step_one(Estimator &self, amb_real y, amb_real u)
{
  only_one(self);
  const amb_real measured[AMB_SENSORS] = {y}, acted[AMB_CONTROLS] = {u};
  return amb_estimator_step(&self.estimator, self.state(), measured, acted, &self.result);
}

amb_kalman_input input_of(const Estimator &self, const Samples &y, const Samples &u)
{
  const size_t n = samples_of(y, self.sizes().sensors, "y");
  same_length(n, samples_of(u, self.sizes().controls, "u"), "u");
  return {n, y.data(), u.data(), nullptr, nullptr, nullptr};
}

// `on` (n,): 0 while the magnets have no current, else 1.
const amb_real *switched(const std::optional<Samples> &on, size_t n)
{
  if (on)
    same_length(n, samples_of(*on, 1, "on"), "on");
  return on ? on->data() : nullptr;
}

Named run(Estimator &self, const Samples &y, const Samples &u, bool covariance,
          const std::optional<std::string> &instructions)
{
  return run_input(self, input_of(self, y, u), covariance, instructions);
}

#if defined(AMB_MODEL_LOOPS)

// A complete record with a variable speed of rotation, linear between samples.
Named run_turning(Estimator &self, const Samples &y, const Samples &u, const Samples &speed,
                  Model &model, bool covariance, bool measured, const std::optional<Samples> &on)
{
  amb_kalman_input in = input_of(self, y, u);
  in.on = switched(on, in.n);
  same_length(in.n, samples_of(speed, measured ? ROTATION_FIELDS : 1, "speed"), "speed");
  if (!model.turns())
    throw std::invalid_argument("the model knows one speed only");
  const size_t m = self.sizes().sensors, c = self.sizes().controls;
  History history(in.n, self.sizes(), covariance, self.scales());
  {
    nb::gil_scoped_release release;
    for (size_t k = 0; k < in.n; k++) {
      const amb_real *acted = k > 0 ? in.u + (k - 1) * c : nullptr;
      const bool mirrored = self.turn_at(model, speed.data(), k, measured);
      if (k > 0 && in.on != nullptr && !(in.on[k - 1] > 0))
        amb_deenergise(&self.estimator, self.state());
      (void)amb_estimator_step(&self.estimator, self.state(), in.y + k * m, acted, &self.result);
      self.result.status |= mirrored ? AMB_MIRRORED : AMB_OK;
      amb_estimator_note(&self.estimator, self.state(), &self.result, k, &history.to);
    }
  }
  return history.arrays;
}

#endif

Named smooth(Estimator &self, const Samples &y, const Samples &u)
{
  const amb_kalman_input input = input_of(self, y, u);
  History history(input.n, self.sizes(), true, self.scales());
  {
    nb::gil_scoped_release release;
    amb_estimator_run(&self.estimator, self.state(), &input, &history.to);
    amb_smooth(&self.kf, input.n, &history.to);
  }
  return history.arrays;
}

Out<amb_real> forecast(const Estimator &self, const Matrix &mean, const Samples &u, size_t ahead,
                       std::optional<Vector> scale)
{
  const Sizes of = self.sizes();
  const size_t n = mean.shape(0);
  same_length(n, samples_of(u, of.controls, "u"), "u");
  if (scale)
    same_length(n, scale->size(), "scale");
  if (mean.shape(1) != of.states)
    throw std::invalid_argument("mean must have " + std::to_string(of.states) + " columns");
  const size_t made = n > ahead ? n - ahead : 0;
  Fresh<amb_real> y({made, of.sensors});
  {
    nb::gil_scoped_release release;
    for (size_t k = 0; k < made; k++)
      amb_estimator_forecast(&self.estimator, scale ? scale->data()[k] : 1,
                             mean.data() + k * of.states, u.data() + k * of.controls, ahead,
                             y.data + k * of.sensors);
  }
  return y.array;
}

} // namespace

Named run_supplied(Estimator &self, const Samples &y, const Samples &u, bool covariance,
                   const std::optional<std::string> &instructions, const std::optional<Samples> &on)
{
  amb_kalman_input in = input_of(self, y, u);
  in.on = switched(on, in.n);
  return run_input(self, in, covariance, instructions);
}

void bind_steps(nb::class_<Estimator> &estimator)
{
  estimator.def("predict", &predict_one, nb::arg("u"), "One sample on; returns the status.")
      .def("predict", &predict, nb::arg("u"), "The same with u (controls,).")
      .def("update", &update_one, nb::arg("y"), "Take in y; returns the status.")
      .def("update", &update, nb::arg("y"), "The same with y (sensors,).")
      .def("step", &step_one, nb::arg("y"), nb::arg("u"), "Predict with u, update with y.")
      .def("step", &step, nb::arg("y"), nb::arg("u"), "The same with arrays.")
      .def("run", &run, nb::arg("y"), nb::arg("u"), nb::kw_only(), nb::arg("covariance") = false,
           nb::arg("instructions") = nb::none(),
           "A whole record; u[k] acts from sample k to k + 1.")
      .def("smooth", &smooth, nb::arg("y"), nb::arg("u"),
           "A whole record, mean and covariance by all of it (ambkit/smoother.h).")
      .def(
          "forecast", &forecast, nb::arg("mean"), nb::arg("u"), nb::arg("ahead"),
          nb::arg("scale") = nb::none(),
          "Measurements `ahead` samples after each of mean (n, states): (n - ahead, sensors) [m].");
}

#if defined(AMB_MODEL_LOOPS)

void bind_turning(nb::module_ &m)
{
  m.def(
      "run_turning", &run_turning, nb::arg("estimator"), nb::arg("y"), nb::arg("u"),
      nb::arg("speed"), nb::arg("model"), nb::kw_only(), nb::arg("covariance") = false,
      nb::arg("measured") = false, nb::arg("on") = nb::none(),
      nb::sig("def run_turning(estimator: Estimator, y: Any, u: Any, speed: Any, model: Model, "
              "*, covariance: bool = False, measured: bool = False, on: Any = None) -> "
              "dict[str, Any]"),
      "A whole record while the speed of rotation changes (n,) [rad/s], or by what is measured of "
      "it (n, 8), of its own model.");
}

#endif
