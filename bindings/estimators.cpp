// Estimator kinds with known magnets; those that estimate the magnet constant are in
// scale_estimators.cpp.
#include "estimator.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include <nanobind/stl/string.h>

extern "C" {
#include "ambkit/adaptive_noise.h"
#include "ambkit/contact.h"
#include "ambkit/low_pass.h"
#include "ambkit/observer.h"
#include "ambkit/ud.h"
#include "ambkit/unscented.h"
}

namespace
{

struct Kalman : Estimator {
  Kalman(nb::object magnet, nb::object model, nb::kwargs settings)
      : Estimator(amb_kalman_methods, magnet, model, settings)
  {
  }
};

struct Extended : Estimator {
  Extended(nb::object magnet, nb::object model, nb::kwargs settings)
      : Estimator(amb_extended_methods, magnet, model, settings)
  {
  }
  /* Its state is the filter's own: nothing else depends on the covariance. */
  void widen(const Vector &std)
  {
    const size_t n = sizes().states;
    same_length(n, std.size(), "std");
    amb_real *entry = static_cast<amb_kalman_state *>(state())->cov;
    for (size_t i = 0; i < n; entry += n - i, i++)
      *entry += std.data()[i] * std.data()[i];
  }
};

struct UD : Estimator {
  UD(nb::object magnet, nb::object model, nb::kwargs settings)
      : Estimator(amb_ud_methods, magnet, model, settings)
  {
  }
  nb::object factor()
  {
    const auto &s = *static_cast<const amb_ud_state *>(state());
    const size_t n = sizes().states;
    Fresh<amb_real> U({n, n});
    for (size_t i = 0; i < n; i++)
      std::copy_n(s.U[i], n, U.data + i * n);
    return nb::make_tuple(U.array, shown({s.D, s.D + n}, {n}));
  }
};

struct Observer : Estimator {
  amb_observer own{};
  Observer(nb::object magnet, nb::object model, const Matrix &gain, const Vector &cov,
           const Vector &variance, const Vector &far, nb::kwargs settings)
      : Estimator(amb_observer_methods, magnet, model, settings)
  {
    const Sizes of = sizes();
    same_length(of.sensors, gain.shape(0), "gain");
    same_length(of.states, gain.shape(1), "gain");
    for (size_t r = 0; r < of.sensors; r++)
      std::copy_n(gain.data() + r * of.states, of.states, own.gain[r]);
    fill(own.cov, cov, of.entries, "cov");
    fill(own.variance, variance, of.sensors, "variance");
    fill(own.far, far, of.states, "far");
    estimator.own = &own;
  }
  nb::dict more() const override
  {
    const Sizes of = sizes();
    Fresh<amb_real> gain({of.sensors, of.states});
    for (size_t r = 0; r < of.sensors; r++)
      std::copy_n(own.gain[r], of.states, gain.data + r * of.states);
    nb::dict d;
    d["gain"] = gain.array;
    d["cov"] = shown({own.cov, own.cov + of.entries}, {of.entries});
    d["variance"] = shown({own.variance, own.variance + of.sensors}, {of.sensors});
    d["far"] = shown({own.far, own.far + of.states}, {of.states});
    return d;
  }
};

struct LowPass : Estimator {
  amb_low_pass own;
  LowPass(nb::object magnet, nb::object model, amb_real m, amb_real position, amb_real velocity,
          amb_real force, nb::kwargs settings)
      : Estimator(amb_low_pass_methods, magnet, model, settings), own{m, position, velocity, force}
  {
    must_be_single("a low-pass filter");
    must_have({AMB_POSITION, AMB_VELOCITY, AMB_LOAD}, "a low-pass filter");
    if (sizes().forces != 1)
      throw std::invalid_argument("a low-pass filter takes one magnet force; the model has " +
                                  std::to_string(sizes().forces));
    estimator.own = &own;
  }
  nb::dict more() const override
  {
    nb::dict d;
    d["m"] = own.m;
    d["position"] = own.position;
    d["velocity"] = own.velocity;
    d["force"] = own.force;
    return d;
  }
};

struct Unscented : Estimator {
  amb_unscented own;
  Unscented(nb::object magnet, nb::object model, amb_real reach, amb_real curvature,
            nb::kwargs settings)
      : Estimator(amb_unscented_methods, magnet, model, settings), own{reach, curvature}
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

struct Contact : Estimator {
  amb_contact own{};
  Contact(nb::object magnet, nb::object model, const Places &first, const Places &second,
          const Matrix &numbers, const Matrix &displacement, const Matrix &velocity,
          const Matrix &later, const Matrix &coupling, const Vector &bias, bool brief,
          amb_real scatter, nb::kwargs settings)
      : Estimator(amb_contact_methods, magnet, model, settings)
  {
    const size_t rings = first.size();
    if (rings > sizes().forces)
      throw std::invalid_argument("there are more stops than magnets");
    own.rings = static_cast<int>(rings);
    axes(own.first, first, rings, "first");
    axes(own.second, second, rings, "second");
    same_length(std::size(by_ring), numbers.shape(0), "numbers");
    same_length(rings, numbers.shape(1), "numbers");
    const amb_real *from = numbers.data();
    for (const auto &[name, member] : by_ring) {
      std::copy_n(from, rings, own.*member);
      from += rings;
    }
    rows(own.displacement, displacement, "displacement");
    rows(own.velocity, velocity, "velocity");
    rows(own.later, later, "later");
    own.seen = 1;
    for (size_t f = 0; f < sizes().forces; f++)
      for (int i = 0; i < static_cast<int>(sizes().states); i++)
        if (own.displacement[f][i] != 0 || own.velocity[f][i] != 0)
          own.seen = std::max(own.seen, i + 1);
    same_length(sizes().forces, coupling.shape(0), "coupling");
    same_length(sizes().forces, coupling.shape(1), "coupling");
    for (size_t f = 0; f < sizes().forces; f++)
      std::copy_n(coupling.data() + f * sizes().forces, sizes().forces, own.coupling[f]);
    own.brief = brief;
    own.scatter_squared = scatter * scatter;
    fill(own.bias, bias, sizes().forces, "bias");
    estimator.own = &own;
  }
  nb::dict more() const override
  {
    const Sizes of = sizes();
    nb::dict d;
    d["rings"] = own.rings;
    d["seen"] = own.seen;
    d["first"] = copied(own.first, of.forces);
    d["second"] = copied(own.second, of.forces);
    for (const auto &[name, member] : by_ring)
      d[name] = copied(own.*member, of.forces);
    d["displacement"] = of_axes(own.displacement);
    d["velocity"] = of_axes(own.velocity);
    d["later"] = of_axes(own.later);
    Fresh<amb_real> coupling({of.forces, of.forces});
    for (size_t f = 0; f < of.forces; f++)
      std::copy_n(own.coupling[f], of.forces, coupling.data + f * of.forces);
    d["coupling"] = nb::cast(coupling.array);
    d["brief"] = own.brief;
    d["scatter_squared"] = own.scatter_squared;
    d["bias"] = copied(own.bias, of.forces);
    return d;
  }
  // Along the axes (n, forces), from means (n, states), currents (n, controls), and whether there
  // are currents at all (n,).
  nb::object contact_forces(const Matrix &means, const Matrix &iu,
                            const std::optional<Vector> &on) const
  {
    const Sizes of = sizes();
    same_length(of.states, means.shape(1), "means");
    same_length(of.controls, iu.shape(1), "iu");
    same_length(means.shape(0), iu.shape(0), "iu");
    if (on)
      same_length(means.shape(0), on->size(), "on");
    amb_real beside[AMB_FORCES];
    Fresh<amb_real> forces({means.shape(0), of.forces});
    for (size_t k = 0; k < means.shape(0); k++)
      amb_contact_forces(&estimator, means.data() + k * of.states, iu.data() + k * of.controls,
                         amb_real(1), on && !(on->data()[k] > 0), beside,
                         forces.data + k * of.forces);
    return nb::cast(forces.array);
  }

private:
  // In the order of the rows of `numbers`.
  static constexpr std::pair<const char *, amb_real (amb_contact::*)[AMB_FORCES]> by_ring[] = {
      {"clearance", &amb_contact::clearance}, {"stiffness", &amb_contact::stiffness},
      {"damping", &amb_contact::damping},     {"friction", &amb_contact::friction},
      {"surface", &amb_contact::surface},     {"compliance", &amb_contact::compliance},
      {"mobility", &amb_contact::mobility}};
  void axes(unsigned short *to, const Places &from, size_t rings, const char *name)
  {
    same_length(rings, from.size(), name);
    for (size_t r = 0; r < rings; r++) {
      if (from.data()[r] >= sizes().forces)
        throw std::invalid_argument(std::string(name) + ": there is no such axis");
      to[r] = from.data()[r];
    }
  }
  void rows(amb_real to[][AMB_STATES], const Matrix &from, const char *name)
  {
    const Sizes of = sizes();
    same_length(of.forces, from.shape(0), name);
    same_length(of.states, from.shape(1), name);
    for (size_t f = 0; f < of.forces; f++)
      std::copy_n(from.data() + f * of.states, of.states, to[f]);
  }
  nb::object of_axes(const amb_real from[][AMB_STATES]) const
  {
    const Sizes of = sizes();
    Fresh<amb_real> copy({of.forces, of.states});
    for (size_t f = 0; f < of.forces; f++)
      std::copy_n(from[f], of.states, copy.data + f * of.states);
    return nb::cast(copy.array);
  }
  template <typename T> static nb::object copied(const T *from, size_t n)
  {
    Fresh<T> copy({n});
    std::copy_n(from, n, copy.data);
    return nb::cast(copy.array);
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
    if (!((measurement || disturbance) && amb_is_positive(share) && share <= first_share &&
          first_share < 1 && most > 1 && amb_is_finite(most) && window > 0 &&
          own.inner.methods->state_size <= sizeof(amb_adaptive_noise_inner)))
      throw std::invalid_argument("a parameter of the adaptation is outside its range");
    if (disturbance)
      must_have({AMB_LOAD}, "finding the growth of the disturbance");
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
    const Sizes of = sizes();
    return nb::make_tuple(shown({s.kf.set.var_y, s.kf.set.var_y + of.sensors}, {of.sensors}),
                          shown({s.kf.set.var_d, s.kf.set.var_d + of.noises}, {of.noises}));
  }
};

Named run_kalman(Kalman &self, const Samples &y, const Samples &u, std::optional<Samples> k_i,
                 std::optional<Samples> k_s, bool covariance,
                 const std::optional<std::string> &instructions)
{
  const Sizes of = self.sizes();
  const size_t n = samples_of(y, of.sensors, "y");
  same_length(n, samples_of(u, of.controls, "u"), "u");
  if (k_i.has_value() != k_s.has_value())
    throw std::invalid_argument("k_i and k_s are given together or not at all");
  if (k_i) {
    same_length(n, samples_of(*k_i, of.forces, "k_i"), "k_i");
    same_length(n, samples_of(*k_s, of.forces, "k_s"), "k_s");
  }
  return run_input(
      self, {n, y.data(), u.data(), k_i ? k_i->data() : nullptr, k_s ? k_s->data() : nullptr},
      covariance, instructions);
}

} // namespace

void bind_estimators(nb::module_ &m)
{
  nb::class_<Kalman, Estimator>(m, "Kalman", "Kalman filter (paper, eq. 7-21, Fig. 8).")
      .def(
          nb::init<nb::object, nb::object, nb::kwargs>(), nb::arg("magnet"), nb::arg("model"),
          nb::arg("settings"),
          nb::sig(
              "def __init__(self, magnet: Magnet | list[Magnet], model: Model, **settings: Any) -> "
              "None"))
      .def("run", &run_kalman, nb::arg("y"), nb::arg("u"), nb::arg("k_i") = nb::none(),
           nb::arg("k_s") = nb::none(), nb::kw_only(), nb::arg("covariance") = false,
           nb::arg("instructions") = nb::none(),
           "A whole record, with given stiffnesses (n,) or the magnet's.");
  nb::class_<Extended, Estimator>(m, "Extended", "Extended Kalman filter.")
      .def(
          nb::init<nb::object, nb::object, nb::kwargs>(), nb::arg("magnet"), nb::arg("model"),
          nb::arg("settings"),
          nb::sig(
              "def __init__(self, magnet: Magnet | list[Magnet], model: Model, **settings: Any) -> "
              "None"))
      .def("widen", &Extended::widen, nb::arg("std"),
           "Know the state less surely: by standard deviations (states,) more, uncorrelated.");
  nb::class_<UD, Estimator>(m, "UD", "Extended filter on a factor (ambkit/ud.h).")
      .def(
          nb::init<nb::object, nb::object, nb::kwargs>(), nb::arg("magnet"), nb::arg("model"),
          nb::arg("settings"),
          nb::sig(
              "def __init__(self, magnet: Magnet | list[Magnet], model: Model, **settings: Any) -> "
              "None"))
      .def_prop_ro("factor", &UD::factor,
                   "U (states, states) and D (states,) of the covariance U D U'.");
  nb::class_<Unscented, Estimator>(m, "Unscented", "Unscented filter (ambkit/unscented.h).")
      .def(nb::init<nb::object, nb::object, amb_real, amb_real, nb::kwargs>(), nb::arg("magnet"),
           nb::arg("model"), nb::arg("reach"), nb::arg("curvature"), nb::arg("settings"),
           nb::sig("def __init__(self, magnet: Magnet | list[Magnet], model: Model, reach: float, "
                   "curvature: float, **settings: Any) -> None"));
  nb::class_<Contact, Estimator>(m, "Contact", "Extended filter with stops (ambkit/contact.h).")
      .def(nb::init<nb::object, nb::object, const Places &, const Places &, const Matrix &,
                    const Matrix &, const Matrix &, const Matrix &, const Matrix &, const Vector &,
                    bool, amb_real, nb::kwargs>(),
           nb::arg("magnet"), nb::arg("model"), nb::arg("first"), nb::arg("second"),
           nb::arg("numbers"), nb::arg("displacement"), nb::arg("velocity"), nb::arg("later"),
           nb::arg("coupling"), nb::arg("bias"), nb::arg("brief"), nb::arg("scatter"),
           nb::arg("settings"),
           nb::sig("def __init__(self, magnet: Magnet | list[Magnet], model: Model, first: Any, "
                   "second: Any, numbers: Any, displacement: Any, velocity: Any, later: Any, "
                   "coupling: Any, "
                   "bias: Any, brief: bool, scatter: float, **settings: Any) -> None"))
      .def("run", &run_supplied, nb::arg("y"), nb::arg("u"), nb::kw_only(),
           nb::arg("covariance") = false, nb::arg("instructions") = nb::none(),
           nb::arg("on") = nb::none(),
           "A whole record; the magnets have no current from sample k to k + 1 where on[k] is 0.")
      .def(
          "deenergise", [](Contact &self) { amb_contact_deenergise(self.state()); },
          "Before a prediction: the magnets had no current.")
      .def("contact_forces", &Contact::contact_forces, nb::arg("means"), nb::arg("iu"),
           nb::arg("on") = nb::none(),
           "Contact forces along the axes (n, forces) [N] over the samples that begin at means of "
           "the states (n, states), under control currents (n, controls) [A] where `on` (n,) is "
           "1, and without magnet forces where it is 0.");
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
      .def(nb::init<nb::object, nb::object, const Matrix &, const Vector &, const Vector &,
                    const Vector &, nb::kwargs>(),
           nb::arg("magnet"), nb::arg("model"), nb::arg("gain"), nb::arg("cov"),
           nb::arg("variance"), nb::arg("far"), nb::arg("settings"),
           nb::sig("def __init__(self, magnet: Magnet | list[Magnet], model: Model, "
                   "gain: NDArray[Any], cov: NDArray[Any], variance: NDArray[Any], "
                   "far: NDArray[Any], **settings: Any) -> None"));
  nb::class_<LowPass, Estimator>(m, "LowPass", "Low-pass filters (ambkit/low_pass.h).")
      .def(nb::init<nb::object, nb::object, amb_real, amb_real, amb_real, amb_real, nb::kwargs>(),
           nb::arg("magnet"), nb::arg("model"), nb::arg("m"), nb::arg("position"),
           nb::arg("velocity"), nb::arg("force"), nb::arg("settings"),
           nb::sig("def __init__(self, magnet: Magnet | list[Magnet], model: Model, m: float, "
                   "position: float, velocity: float, force: float, **settings: Any) -> None"));
}
