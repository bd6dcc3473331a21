// The kinds of the family that know their magnet; those that learn it are in scale_estimators.cpp.
#include "estimator.h"

extern "C" {
#include "ambkit/adaptive_noise.h"
#include "ambkit/low_pass.h"
#include "ambkit/observer.h"
#include "ambkit/square_root.h"
#include "ambkit/unscented.h"
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
  /* Its state is the filter's own: nothing else depends on the covariance. */
  void widen(const Vector &std)
  {
    same_length(AMB_AXIAL_STATES, std.size(), "std");
    amb_real *entry = static_cast<amb_kalman_state *>(state())->cov;
    for (size_t i = 0; i < AMB_AXIAL_STATES; entry += AMB_AXIAL_STATES - i, i++)
      *entry += std.data()[i] * std.data()[i];
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
           const Vector &far, nb::kwargs settings)
      : Estimator(amb_observer_methods, asked, settings)
  {
    same_length(AMB_AXIAL_STATES, gain.size(), "gain");
    same_length(AMB_AXIAL_TRIANGLE, cov.size(), "cov");
    std::copy_n(gain.data(), AMB_AXIAL_STATES, own.gain);
    std::copy_n(cov.data(), AMB_AXIAL_TRIANGLE, own.cov);
    own.variance = variance;
    same_length(AMB_AXIAL_STATES, far.size(), "far");
    std::copy_n(far.data(), AMB_AXIAL_STATES, own.far);
    estimator.own = &own;
  }
  nb::dict more() const override
  {
    nb::dict d;
    d["gain"] = shown({own.gain, own.gain + AMB_AXIAL_STATES}, {AMB_AXIAL_STATES});
    d["cov"] = shown({own.cov, own.cov + AMB_AXIAL_TRIANGLE}, {AMB_AXIAL_TRIANGLE});
    d["variance"] = own.variance;
    d["far"] = shown({own.far, own.far + AMB_AXIAL_STATES}, {AMB_AXIAL_STATES});
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

} // namespace

void bind_estimators(nb::module_ &m)
{
  nb::class_<Kalman, Estimator>(m, "Kalman", "Kalman filter (paper, eq. 7-21, Fig. 8).")
      .def(nb::init<nb::object, nb::kwargs>(), nb::arg("magnet"), nb::arg("settings"),
           nb::sig("def __init__(self, magnet: Magnet, **settings: float) -> None"))
      .def("run", &run_kalman, nb::arg("y"), nb::arg("u"), nb::arg("k_i") = nb::none(),
           nb::arg("k_s") = nb::none(), nb::kw_only(), nb::arg("covariance") = false,
           "A whole record, with given stiffnesses (n,) or the magnet's.");
  nb::class_<Extended, Estimator>(m, "Extended", "Extended Kalman filter.")
      .def(nb::init<nb::object, nb::kwargs>(), nb::arg("magnet"), nb::arg("settings"),
           nb::sig("def __init__(self, magnet: Magnet, **settings: float) -> None"))
      .def("widen", &Extended::widen, nb::arg("std"),
           "Know the state less surely: by standard deviations (4,) more, uncorrelated.");
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
      .def(nb::init<nb::object, const Vector &, const Vector &, amb_real, const Vector &,
                    nb::kwargs>(),
           nb::arg("magnet"), nb::arg("gain"), nb::arg("cov"), nb::arg("variance"), nb::arg("far"),
           nb::arg("settings"),
           nb::sig("def __init__(self, magnet: Magnet, gain: NDArray[Any], cov: NDArray[Any], "
                   "variance: float, far: NDArray[Any], **settings: float) -> None"));
  nb::class_<LowPass, Estimator>(m, "LowPass", "Low-pass filters (ambkit/low_pass.h).")
      .def(nb::init<nb::object, amb_real, amb_real, amb_real, nb::kwargs>(), nb::arg("magnet"),
           nb::arg("position"), nb::arg("velocity"), nb::arg("force"), nb::arg("settings"),
           nb::sig("def __init__(self, magnet: Magnet, position: float, velocity: float, "
                   "force: float, **settings: float) -> None"));
}
