// Fault isolation beside a filter (ambkit/isolation.h).
#include "estimator.h"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <optional>
#include <tuple>

extern "C" {
#include "ambkit/isolation.h"
}

namespace
{

struct Isolation {
  amb_isolation isolation{};
  std::vector<amb_fault> faults;
  std::vector<amb_fault_term> terms;
  Kept kept;
  std::vector<amb_real> ring, work;
  amb_isolation_state state{};
  amb_real speed = 0; // of the machine [rad/s]

  void reset()
  {
    amb_isolation_reset(&isolation, &state);
  }
};

void init_isolation(Isolation *self, const nb::dict &of)
{
  new (self) Isolation{};
  amb_isolation &is = self->isolation;
  for (const auto &[name, to] :
       std::initializer_list<std::pair<const char *, int &>>{{"states", is.states},
                                                             {"forces", is.forces},
                                                             {"sensors", is.sensors},
                                                             {"columns", is.columns},
                                                             {"tones", is.tones},
                                                             {"forms", is.forms},
                                                             {"gradients", is.gradients},
                                                             {"window", is.window},
                                                             {"spare", is.spare},
                                                             {"late", is.late}})
    read(of, name, to);
  for (const auto &[name, to] :
       std::initializer_list<std::pair<const char *, amb_real &>>{{"speed", self->speed},
                                                                  {"limit", is.limit},
                                                                  {"like", is.like},
                                                                  {"fine", is.fine},
                                                                  {"alike", is.alike},
                                                                  {"margin", is.margin}})
    read(of, name, to);
  if (is.late < 1 || is.late > AMB_ISOLATION_LEAST || is.window <= AMB_ISOLATION_LEAST ||
      is.spare < 0 || is.states < 1 || is.states > AMB_STATES)
    throw std::invalid_argument("window, spare, late or states are out of range");
  const auto n = static_cast<size_t>(is.states), p = static_cast<size_t>(is.forces);
  const auto m = static_cast<size_t>(is.sensors);
  is.A = self->kept.numbers(of, "A", n * n);
  is.b = self->kept.numbers(of, "b", p * n);
  is.H = self->kept.numbers(of, "H", m * n);
  is.bias = self->kept.numbers(of, "bias", p);
  is.F_0 = self->kept.numbers(of, "F_0", p);
  is.unit = self->kept.numbers(of, "unit", n);
  is.K = self->kept.or_none(of, "K", m * n);
  is.form = self->kept.numbers(of, "form", static_cast<size_t>(is.forms) * n);
  is.gradient = self->kept.numbers(of, "gradient", static_cast<size_t>(is.gradients) * n);
  is.lag = self->kept.numbers(of, "lag", m * 2);
  is.h = self->kept.numbers(of, "h", p * n);
  is.k_s = self->kept.numbers(of, "k_s", p);
  is.turn = self->kept.numbers(of, "turn", static_cast<size_t>(is.tones) * 2);
  const int signals =
      1 + (AMB_OF_FORCE + 2) * is.forces + AMB_OF_SENSOR * is.sensors + 2 * is.tones;
  if (is.forms != 2 * is.forces || is.tones > AMB_TONES)
    throw std::invalid_argument("two forms for each force, and at most two tones");
  using Fault = std::tuple<int, int, bool, int>;
  for (nb::handle one : nb::cast<nb::list>(of["faults"])) {
    const auto [column, columns, load, group] = nb::cast<Fault>(one);
    if (column < 0 || columns < 1 || columns > 2 || column + columns > is.columns)
      throw std::invalid_argument("a fault has one or two of the columns");
    self->faults.push_back({static_cast<unsigned short>(column),
                            static_cast<unsigned short>(columns), static_cast<unsigned short>(load),
                            static_cast<unsigned short>(group)});
  }
  using Term = std::tuple<int, int, int, int, amb_real>;
  for (nb::handle one : nb::cast<nb::list>(of["terms"])) {
    const auto [column, direction, signal, gradient, weight] = nb::cast<Term>(one);
    if (column < 0 || column >= is.columns || direction < 0 ||
        direction >= 2 * is.forces + is.sensors || signal < 0 || signal >= signals ||
        gradient < 0 || gradient > is.forces + is.gradients + is.sensors)
      throw std::invalid_argument("a term has a column, direction or signal that is not there");
    if (!self->terms.empty() && column < self->terms.back().column)
      throw std::invalid_argument("terms are in the order of their columns");
    self->terms.push_back(
        {static_cast<unsigned short>(column), static_cast<unsigned short>(direction),
         static_cast<unsigned short>(signal), static_cast<unsigned short>(gradient), weight});
  }
  is.faults = static_cast<int>(self->faults.size());
  is.terms = static_cast<int>(self->terms.size());
  is.fault = self->faults.data();
  is.term = self->terms.data();
  const auto rows = static_cast<size_t>(is.window + is.spare);
  self->ring.resize(rows * static_cast<size_t>(amb_isolation_row(&is)));
  self->work.resize(static_cast<size_t>(amb_isolation_work(&is)));
  self->state.ring = self->ring.data();
  self->state.work = self->work.data();
  self->reset();
}

// Run the filter along a record, and search the window every `every` samples. `model` and `speed`
// for a record with variable speed of rotation.
Named run(Isolation &self, Estimator &filter, const Samples &y, const Samples &u, size_t every,
          Model *model, const std::optional<Samples> &speed, bool measured)
{
  const Sizes of = filter.sizes();
  const size_t n = samples_of(y, of.sensors, "y"), faults = self.faults.size();
  same_length(n, samples_of(u, of.controls, "u"), "u");
  if (self.isolation.states != static_cast<int>(of.states) ||
      self.isolation.forces != static_cast<int>(of.forces) ||
      self.isolation.sensors != static_cast<int>(of.sensors) || every < 1)
    throw std::invalid_argument("the isolation is of another machine, or `every` is 0");
  if (speed)
    same_length(n, samples_of(*speed, measured ? ROTATION_FIELDS : 1, "speed"), "speed");
  const size_t searches = n / every;
  Results out;
  auto *likelihood = out.add<amb_real>("likelihood", {searches, faults});
  auto *size = out.add<amb_real>("size", {searches, faults, 2});
  auto *variance = out.add<amb_real>("variance", {searches, faults, 2});
  auto *since = out.add<int>("since", {searches, faults});
  auto *instead = out.add<int>("instead", {searches, faults});
  auto *contact = out.add<int>("contact", {searches});
  auto *roughness = out.add<amb_real>("roughness", {searches});
  auto *earlier = out.add<unsigned char>("before", {searches, faults});
  {
    nb::gil_scoped_release release;
    self.reset();
    std::vector<amb_isolation_result> result(faults);
    size_t at = 0;
    for (size_t k = 0; k < n; k++) {
      amb_real faster = 0;
#if defined(AMB_MODEL_LOOPS)
      if (model != nullptr && speed) {
        filter.turn_at(*model, speed->data(), k, measured);
        faster = (speed->data()[measured ? k * ROTATION_FIELDS : k] - self.speed) * filter.kf.set.T;
      }
#endif
      const amb_real *before = (k > 0) ? u.data() + (k - 1) * of.controls : nullptr;
      filter.result.status = amb_estimator_step(&filter.estimator, filter.state(),
                                                y.data() + k * of.sensors, before, &filter.result);
      amb_isolation_put(&self.isolation, &self.state, &filter.kf, filter.magnets.data(),
                        &filter.base(), &filter.result, faster);
      if ((k + 1) % every != 0)
        continue;
      contact[at] = self.state.contact;
      roughness[at] = *std::max_element(self.state.roughness, self.state.roughness + of.sensors);
      (void)amb_isolation_evaluate(&self.isolation, &self.state, &filter.kf, filter.magnets.data(),
                                   result.data());
      for (size_t j = 0; j < faults; j++) {
        const amb_isolation_result &one = result[j];
        likelihood[at * faults + j] = one.likelihood;
        std::copy_n(one.size, 2, size + (at * faults + j) * 2);
        std::copy_n(one.variance, 2, variance + (at * faults + j) * 2);
        since[at * faults + j] = one.since;
        instead[at * faults + j] = one.instead;
        earlier[at * faults + j] = one.before ? 1 : 0;
      }
      at++;
    }
  }
  return out.named();
}

Out<amb_real> information(Isolation &self, Estimator &filter, int since, bool before)
{
  const auto c = static_cast<size_t>(self.isolation.columns);
  Fresh<amb_real> matrix({c, c});
  amb_isolation_information(&self.isolation, &self.state, &filter.kf, filter.magnets.data(), since,
                            before, matrix.data);
  return matrix.array;
}

} // namespace

void bind_isolation(nb::module_ &m)
{
  nb::class_<Isolation>(m, "Isolation", "Fault isolation beside a filter (ambkit/isolation.h).")
      .def("__init__", &init_isolation, nb::arg("of"),
           nb::sig("def __init__(self, of: dict[str, Any]) -> None"))
      .def("run", &run, nb::arg("filter"), nb::arg("y"), nb::arg("u"), nb::arg("every"),
           nb::arg("model").none() = nb::none(), nb::arg("speed").none() = nb::none(),
           nb::arg("measured") = false,
           nb::sig("def run(self, filter: Any, y: Any, u: Any, every: int, model: Any = None, "
                   "speed: Any = None, measured: bool = False) -> dict[str, Any]"),
           "Run a filter along a record, and search the window every so many samples; `speed` as "
           "`run_turning` takes it.")
      .def_prop_ro(
          "room",
          [](const Isolation &s) {
            return std::tuple(amb_isolation_row(&s.isolation), amb_isolation_work(&s.isolation));
          },
          "Numbers of a row of the ring, and of the memory to work in.")
      .def("information", &information, nb::arg("filter"), nb::arg("since"), nb::arg("before"),
           nb::sig("def information(self, filter: Any, since: int, before: bool) -> Any"),
           "Information of all columns on faults that began so many samples ago; `before`: beside "
           "any error then.");
}
