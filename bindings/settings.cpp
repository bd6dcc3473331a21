// Default settings of filters (sim/settings.h), in double in every build.
#include "arrays.h"

extern "C" {
#include "settings.h"
}

namespace
{

// A machine as seen by its filters, and its arrays.
class View
{
public:
  amb_view of{};
  explicit View(const nb::dict &fields)
  {
    const auto numbers = [&](const char *name, size_t count) {
      kept.push_back(nb::cast<std::vector<double>>(fields[name]));
      same_length(count, kept.back().size(), name);
      return kept.back().data();
    };
    const auto count = [&](const char *name) { return nb::len(nb::cast<nb::list>(fields[name])); };
    const auto axes = count("mass"), sensors = count("K_sen"), positions = count("travel");
    of.T = nb::cast<double>(fields["T"]);
    of.axes = static_cast<int>(axes);
    of.sensors = static_cast<int>(sensors);
    of.positions = static_cast<int>(positions);
    of.mass = numbers("mass", axes);
    of.clearance = numbers("clearance", axes);
    of.stiffness = numbers("stiffness", axes);
    of.k_i = numbers("k_i", axes);
    of.k_ui = numbers("k_ui", axes);
    of.current_limit = numbers("current_limit", axes);
    of.var_u = numbers("var_u", axes);
    of.K_sen = numbers("K_sen", sensors);
    of.lag = numbers("lag", sensors);
    of.step = numbers("step", sensors);
    of.var_y = numbers("var_y", sensors);
    of.range = numbers("range", sensors);
    of.run_out = numbers("run_out", sensors);
    of.travel = numbers("travel", positions);
    of.seen = numbers("seen", positions * sensors);
    of.bent = numbers("bent", positions);
  }

private:
  std::list<std::vector<double>> kept; // a list, because its elements never move
};

std::vector<double> intensity(const nb::dict &fields)
{
  const View view(fields);
  std::vector<double> result;
  for (int f = 0; f < view.of.axes; f++)
    result.push_back(amb_view_intensity(&view.of, f));
  return result;
}

double dwell(const nb::dict &fields)
{
  const View view(fields);
  return amb_view_dwell(&view.of);
}

nb::tuple caps_and_start(const nb::dict &fields, const std::vector<unsigned char> &role,
                         const std::vector<int> &index, const std::vector<double> &size,
                         const std::vector<double> &vague, const std::vector<double> &var_y)
{
  const View view(fields);
  const amb_view_states states = {static_cast<int>(role.size()), role.data(), index.data(),
                                  size.data(), vague.data()};
  std::vector<double> cap(role.size()), std(role.size());
  amb_view_caps(&view.of, &states, cap.data());
  amb_view_start(&view.of, &states, var_y.data(), std.data());
  return nb::make_tuple(cap, std);
}

std::vector<double> corners(const nb::dict &fields, double var_y, double by_force)
{
  const View view(fields);
  std::vector<double> result(3);
  amb_view_corners(&view.of, var_y, by_force, result.data());
  return result;
}

} // namespace

void bind_settings(nb::module_ &m)
{
  m.def("intensity", &intensity, nb::arg("view"),
        nb::sig("def intensity(view: dict[str, Any]) -> list[float]"),
        "Process noise intensities of the axes of a machine [N^2/s].");
  m.def("dwell", &dwell, nb::arg("view"), nb::sig("def dwell(view: dict[str, Any]) -> float"),
        "Samples for which a rotor at rest stays within a very coarse step of its sensor.");
  m.def("caps_and_start", &caps_and_start, nb::arg("view"), nb::arg("role"), nb::arg("index"),
        nb::arg("size"), nb::arg("vague"), nb::arg("var_y"),
        nb::sig("def caps_and_start(view: dict[str, Any], role: list[int], index: list[int], size: "
                "list[float], vague: list[float], var_y: list[float]) -> tuple[list[float], "
                "list[float]]"),
        "The most that each state can be, and its standard deviation at the start.");
  m.def("corners", &corners, nb::arg("view"), nb::arg("var_y"), nb::arg("intensity"),
        nb::sig("def corners(view: dict[str, Any], var_y: float, intensity: float) -> list[float]"),
        "Corner frequencies of the low-pass filters of an axis [rad/s].");
}
