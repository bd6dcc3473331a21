#include "arrays.h"

extern "C" {
#include "ambkit/angle.h"
}

namespace
{

Named run_angle(const nb::dict &arguments, const Vector &readings)
{
  amb_angle_settings set{};
  const auto number = [&arguments](const char *name) {
    return nb::cast<amb_real>(arguments[name]);
  };
  set.sensor = static_cast<amb_angle_sensor>(nb::cast<int>(arguments["sensor"]));
  set.per_turn = number("per_turn");
  set.T = number("T");
  set.noise = number("noise");
  set.latency = number("latency");
  set.latency_error = number("latency_error");
  set.gain_error = number("gain_error");
  set.acceleration = number("acceleration");
  set.max_speed = number("max_speed");
  set.reverses = nb::cast<bool>(arguments["reverses"]);
  set.backwards = nb::cast<bool>(arguments["backwards"]);
  if (amb_angle_check(&set) != AMB_OK)
    throw std::invalid_argument("angle: a setting is out of range");
  const size_t n = readings.size();
  Results out;
  auto *mean = out.add<amb_real>("mean", {n, 3});
  auto *variance = out.add<amb_real>("variance", {n});
  auto *speed_variance = out.add<amb_real>("speed_variance", {n});
  auto *rotation = out.add<amb_real>("rotation", {n, 11});
  auto *status = out.add<unsigned char>("status", {n});
  {
    nb::gil_scoped_release release;
    amb_angle_state state{};
    amb_angle_reset(&set, &state);
    for (size_t k = 0; k < n; k++) {
      amb_rotation at{};
      status[k] =
          static_cast<unsigned char>(amb_angle_follow(&set, &state, readings.data()[k], &at));
      const amb_real row[] = {at.speed,
                              at.acceleration,
                              at.kept,
                              at.noise,
                              at.change,
                              amb_real(at.lost ? 1 : 0),
                              amb_real(at.afresh ? 1 : 0),
                              at.process_noise,
                              at.prior,
                              at.estimate,
                              at.now};
      std::copy_n(row, 11, rotation + 11 * k);
      std::copy_n(state.mean, 3, mean + 3 * k);
      variance[k] = amb_angle_variance(&set, &state);
      speed_variance[k] = amb_angle_speed_variance(&set, &state);
    }
  }
  return out.named();
}

} // namespace

void bind_angle(nb::module_ &m)
{
  m.def("run_angle", &run_angle, nb::arg("settings"), nb::arg("readings"),
        nb::sig("def run_angle(settings: dict[str, Any], readings: Any) -> dict[str, Any]"),
        "The rotor's angle along readings (n,) of its sensor, see ambkit/angle.h.");
}
