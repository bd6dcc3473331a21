// Sampling of a continuous model (ambkit/sampling.h), in double in every build.
#include "arrays.h"

#include <nanobind/stl/tuple.h>

extern "C" {
#include "ambkit/rebuild.h"
}

namespace
{

using Doubles = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;
using Square = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Bytes = nb::ndarray<const unsigned char, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// Size of the last two dimensions, which must be equal.
int order_of(const Doubles &A)
{
  if (A.ndim() < 2 || A.shape(A.ndim() - 1) != A.shape(A.ndim() - 2))
    throw std::invalid_argument("A must be square matrices (..., n, n)");
  return static_cast<int>(A.shape(A.ndim() - 1));
}

void must_be_finite(bool finite)
{
  if (!finite)
    throw std::invalid_argument("a continuous model must be finite");
}

Out<double> transition(const Doubles &A, double time)
{
  const int n = order_of(A);
  const size_t square = static_cast<size_t>(n) * static_cast<size_t>(n);
  std::vector<size_t> shape;
  for (size_t k = 0; k < A.ndim(); k++)
    shape.push_back(A.shape(k));
  auto *Phi = new double[A.size() > 0 ? A.size() : 1];
  nb::capsule owner(Phi, [](void *p) noexcept { delete[] static_cast<double *>(p); });
  std::vector<double> work(static_cast<size_t>(AMB_SAMPLING_WORK(n)));
  for (size_t at = 0; at < A.size(); at += square)
    must_be_finite(amb_transition(n, A.data() + at, time, Phi + at, work.data()));
  return Out<double>(Phi, shape.size(), shape.data(), owner);
}

Out<double> process_noise(const Square &A, const Square &intensity, double time)
{
  const auto n = A.shape(0), count = intensity.shape(0);
  same_length(n, A.shape(1), "A, in columns,");
  same_length(n, intensity.shape(1), "intensity, in states,");
  Fresh<double> N({count, n, n});
  std::vector<double> work(static_cast<size_t>(AMB_SAMPLING_WORK(static_cast<int>(n))));
  must_be_finite(amb_process_noise(static_cast<int>(n), A.data(), time, static_cast<int>(count),
                                   intensity.data(), N.data, work.data()));
  return N.array;
}

// Demanded currents with dead time, and their arrays.
struct Lates {
  std::vector<std::vector<unsigned short>> past;
  std::vector<amb_late> lates;
  explicit Lates(const nb::list &late)
  {
    past.reserve(nb::len(late)); // no reallocation, so pointers stay valid
    for (const auto item : late) {
      const auto [control, states, share] =
          nb::cast<std::tuple<int, std::vector<unsigned short>, double>>(item);
      past.push_back(states);
      lates.push_back({control, static_cast<int>(states.size()), past.back().data(), share});
    }
  }
};

nb::tuple sampled(double T, int states, int controls, const Places &row, const Places &column,
                  const Bytes &use, const std::vector<double> &value,
                  const std::vector<double> &k_i, const nb::list &late, const Square &intensity)
{
  const Lates of(late);
  amb_plan plan{};
  plan.T = T;
  plan.states = states;
  plan.forces = static_cast<int>(k_i.size());
  plan.controls = controls;
  plan.noises = static_cast<int>(intensity.shape(0));
  plan.terms = static_cast<int>(value.size());
  same_length(value.size(), row.size(), "row");
  same_length(value.size(), column.size(), "column");
  same_length(value.size(), use.size(), "use");
  same_length(static_cast<size_t>(states), intensity.shape(1), "intensity, in states,");
  const auto n = static_cast<size_t>(states), size = static_cast<size_t>(AMB_PLAN_SIZE(&plan));
  for (size_t k = 0; k < value.size(); k++)
    if (row.data()[k] >= size || column.data()[k] >= size)
      throw std::invalid_argument("a term is of what is not there");
  plan.row = row.data();
  plan.column = column.data();
  plan.use = use.data();
  plan.value = value.data();
  plan.k_i = k_i.data();
  plan.lates = static_cast<int>(of.lates.size());
  plan.late = of.lates.data();
  plan.intensity = intensity.data();
  Fresh<double> Phi({size, size}), N({intensity.shape(0), n, n});
  const auto room = static_cast<size_t>(AMB_SAMPLING_WORK(static_cast<int>(size)));
  std::vector<double> work(room + 2 * size * size);
  must_be_finite(amb_plan_sampled(&plan, Phi.data, N.data, work.data()));
  return nb::make_tuple(Phi.array, N.array);
}

Out<amb_real> rebuild(const nb::dict &fields, const std::vector<double> &parameters)
{
  const auto doubles = [&](const char *name) {
    return nb::cast<std::vector<double>>(fields[name]);
  };
  const auto places = [&](const char *name) {
    return nb::cast<std::vector<unsigned short>>(fields[name]);
  };
  const auto bytes = [&](const char *name) {
    return nb::cast<std::vector<unsigned char>>(fields[name]);
  };
  const auto low = doubles("low"), high = doubles("high"), constant = doubles("constant");
  const auto operation = bytes("operation"), use = bytes("use");
  const auto left = places("left"), right = places("right"), row = places("row");
  const auto column = places("column"), value = places("value"), k_i = places("k_i");
  const auto intensity = places("intensity");
  const auto from = nb::cast<std::vector<unsigned int>>(fields["from"]);
  const Lates late(nb::cast<nb::list>(fields["late"]));
  const auto count = [](const auto &values) { return static_cast<int>(values.size()); };
  same_length(low.size(), parameters.size(), "parameters");
  amb_rebuild of{};
  of.parameters = count(low);
  of.low = low.data();
  of.high = high.data();
  of.constants = count(constant);
  of.constant = constant.data();
  of.operations = count(operation);
  of.operation = operation.data();
  of.left = left.data();
  of.right = right.data();
  of.plan.T = nb::cast<double>(fields["T"]);
  of.plan.states = nb::cast<int>(fields["states"]);
  of.plan.forces = nb::cast<int>(fields["forces"]);
  of.plan.controls = nb::cast<int>(fields["controls"]);
  of.plan.noises = nb::cast<int>(fields["noises"]);
  of.plan.terms = count(row);
  of.plan.row = row.data();
  of.plan.column = column.data();
  of.plan.use = use.data();
  of.plan.lates = count(late.lates);
  of.plan.late = late.lates.data();
  of.value = value.data();
  of.k_i = k_i.data();
  of.intensity = intensity.data();
  of.numbers = count(from);
  of.from = from.data();
  Fresh<amb_real> numbers({from.size()});
  std::vector<double> room(static_cast<size_t>(amb_rebuild_room(&of)));
  if (!amb_rebuild_numbers(&of, parameters.data(), numbers.data, room.data()))
    throw std::invalid_argument("a parameter is beyond its limits, or a number is not finite");
  return numbers.array;
}

} // namespace

void bind_sampling(nb::module_ &m)
{
  m.def("transition", &transition, nb::arg("A"), nb::arg("time"),
        nb::sig("def transition(A: Any, time: float) -> Any"),
        "Exponentials of A times a time (..., n, n).");
  m.def("process_noise", &process_noise, nb::arg("A"), nb::arg("intensity"), nb::arg("time"),
        nb::sig("def process_noise(A: Any, intensity: Any, time: float) -> Any"),
        "Covariances that white noises (k, n) leave in the states over a time (k, n, n).");
  m.def("sampled", &sampled, nb::arg("T"), nb::arg("states"), nb::arg("controls"), nb::arg("row"),
        nb::arg("column"), nb::arg("use"), nb::arg("value"), nb::arg("k_i"), nb::arg("late"),
        nb::arg("intensity"),
        nb::sig("def sampled(T: float, states: int, controls: int, row: Any, column: Any, use: "
                "Any, value: list[float], k_i: list[float], late: list[tuple[int, list[int], "
                "float]], intensity: Any) -> tuple[Any, Any]"),
        "Transition of a plan over one sample, and the covariances of its noises.");
  m.def("rebuild", &rebuild, nb::arg("fields"), nb::arg("parameters"),
        nb::sig("def rebuild(fields: dict[str, Any], parameters: list[float]) -> Any"),
        "The numbers of a model, by the fields of amb_rebuild, from its parameters.");
}
