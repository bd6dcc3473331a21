// Many closed loops, evaluated while they run: SIMD lanes (sim/many.h) and threads.
#include "loop_of.h"
#include "work.h"

#include <map>

extern "C" {
#include "many.h"
}

namespace
{

using Doubles = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;
using Tables = nb::typed<nb::list, nb::any>; // start, column and value
using Table = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

// Displacements, velocities and, if known, loads of the axes as functions of an estimator's states.
struct Along {
  Along(const Tables &parts, size_t axes, size_t states_) : states(states_)
  {
    for (const auto item : parts)
      rows.emplace_back(nb::cast<nb::tuple>(item), axes, states, "along");
    if (rows.size() > 3)
      throw std::invalid_argument("along: there are three");
  }
  Along(const Along &) = delete;
  size_t states;
  std::list<Rows> rows;
};

// A run without its number: loop, start and external inputs.
struct Plan {
  ClosedLoop closed_loop;
  amb_many_run run{};

  Plan(const nb::dict &loop, const nb::kwargs &arguments) : Plan(loop, Arguments(arguments))
  {
  }
  Plan(const Plan &) = delete; // `run` points into the object

  // Memory of an estimator's state, in units of the largest alignment.
  size_t memory() const
  {
    const amb_estimator *e = closed_loop.of.loop.estimator;
    return e != nullptr ? e->methods->state_size / sizeof(std::max_align_t) + 1 : 0;
  }
  bool reset(void *state) const
  {
    const amb_estimator *e = closed_loop.of.loop.estimator;
    return e->methods->reset(e, state, mean.data(), std.data()) == AMB_OK;
  }

private:
  std::vector<amb_real> mean, std;
  std::vector<double> std_u, std_y;
  std::optional<Doubles> noise_u, noise_y;
  std::vector<amb_windows> windows;
  nb::object along; // owns its rows

  Plan(const nb::dict &loop, Arguments named) : closed_loop(loop, named)
  {
    const size_t n = closed_loop.in.n, p = closed_loop.of.axes(), m = closed_loop.of.sensors();
    run.loop = &closed_loop.of.loop;
    run.in = closed_loop.in;
    run.key = {named.must<uint64_t>("seed"), 0};
    std_u = named.must<std::vector<double>>("std_u");
    std_y = named.must<std::vector<double>>("std_y");
    same_length(p, std_u.size(), "std_u");
    same_length(m, std_y.size(), "std_y");
    run.std_u = std_u.data();
    run.std_y = std_y.data();
    run.noise_u = noise(noise_u, named.take("noise_u"), n * p, "noise_u");
    run.noise_y = noise(noise_y, named.take("noise_y"), n * m, "noise_y");
    set_windows(named.must<Table>("windows"));
    set_estimator(named.take("mean"), named.take("std"), named.take("along"));
    named.done();
  }
  static const double *noise(std::optional<Doubles> &kept, const nb::object &values, size_t n,
                             const char *name)
  {
    if (values.is_none())
      return nullptr;
    kept = nb::cast<Doubles>(values);
    same_length(n, kept->size(), name);
    return kept->data();
  }
  void set_windows(const Table &of)
  {
    const size_t columns = 7;
    const auto n = static_cast<double>(closed_loop.in.n);
    same_length(closed_loop.of.axes(), of.shape(0), "windows");
    same_length(columns, of.shape(1), "windows");
    for (size_t f = 0; f < of.shape(0); f++) {
      const double *at = of.data() + f * columns;
      if (!(at[0] >= 0 && at[0] < n && at[1] >= 0 && at[1] < n && at[2] <= n && at[4] >= 0 &&
            at[4] <= n))
        throw std::invalid_argument("spans must be within the run");
      const amb_real there = closed_loop.in.r[static_cast<size_t>(at[1]) * of.shape(0) + f];
      const amb_real height = static_cast<amb_real>(at[3]);
      windows.push_back({at[0], at[1], at[2], height, there, at[4], at[5], at[6]});
    }
    run.windows = windows.data();
  }
  void set_estimator(const nb::object &at_mean, const nb::object &at_std, const nb::object &rows)
  {
    if (closed_loop.estimator == nullptr)
      return;
    const size_t states = closed_loop.estimator->sizes().states;
    mean = nb::cast<std::vector<amb_real>>(at_mean);
    std = nb::cast<std::vector<amb_real>>(at_std);
    same_length(states, mean.size(), "mean");
    same_length(states, std.size(), "std");
    along = rows;
    const auto &of = nb::cast<const Along &>(rows);
    same_length(states, of.states, "along");
    size_t i = 0;
    for (const Rows &item : of.rows)
      run.along[i++] = item.to;
    std::vector<std::max_align_t> trial(memory());
    if (!reset(trial.data()))
      throw std::invalid_argument("mean must be finite, std finite and positive");
  }
};

// Memory for the samples of one run at a time.
class Room
{
public:
  amb_loop_output to{};
  std::vector<amb_real> noise_u, noise_y;
  std::vector<unsigned char> touched;

  explicit Room(const Plan &plan)
  {
    const size_t n = plan.closed_loop.in.n, p = plan.closed_loop.of.axes(),
                 m = plan.closed_loop.of.sensors();
    const amb_estimator *e = plan.closed_loop.of.loop.estimator;
    const Sizes of(e != nullptr ? e->kf->model : amb_model{});
    const auto columns = static_cast<size_t>(plan.closed_loop.of.loop.plant.states);
    noise_u.resize(n * p);
    noise_y.resize(n * m);
    touched.resize(n);
    signals.resize(n * (columns + 3 * p + m + of.states + 2 * of.sensors + 2 * of.forces + 2));
    flags.resize(n * (1 + of.sensors));
    amb_real *next = signals.data();
    const auto place = [&next, n](size_t width) {
      amb_real *here = next;
      next += n * width;
      return here;
    };
    for (size_t j = 0; j < columns; j++)
      X.push_back(place(1));
    to.X = X.data();
    to.columns = static_cast<int>(columns);
    to.iu = place(p);
    to.force = place(p);
    to.y = place(m);
    to.u = place(p);
    to.estimate.mean = place(of.states);
    to.estimate.innovation = place(of.sensors);
    to.estimate.variance = place(of.sensors);
    to.estimate.k_i = place(of.forces);
    to.estimate.k_s = place(of.forces);
    to.estimate.scale = place(1);
    to.estimate.scale_variance = place(1);
    to.estimate.status = flags.data();
    to.estimate.health = of.sensors == 1 ? flags.data() : flags.data() + n;
  }

private:
  std::vector<amb_real> signals;
  std::vector<amb_real *> X;
  std::vector<unsigned short> flags;
};

// Indices of the runs that go side by side: of the same group, in their order.
std::vector<std::vector<size_t>> chunks(const std::vector<const Plan *> &plans,
                                        const int64_t *which, size_t count, size_t lanes)
{
  std::vector<std::pair<unsigned int, size_t>> alike;
  for (const Plan *plan : plans)
    alike.emplace_back(lanes > 1 ? amb_many_group(&plan->run) : 0U, plan->closed_loop.in.n);
  std::map<std::pair<unsigned int, size_t>, std::vector<size_t>> waiting;
  std::vector<std::vector<size_t>> full;
  for (size_t i = 0; i < count; i++) {
    const auto &key = alike[static_cast<size_t>(which[i])];
    auto &chunk = waiting[key];
    chunk.push_back(i);
    if (key.first == 0 || chunk.size() == lanes) {
      full.push_back(std::move(chunk));
      chunk.clear();
    }
  }
  for (auto &[key, chunk] : waiting)
    if (!chunk.empty())
      full.push_back(std::move(chunk));
  return full;
}

using Numbers = nb::ndarray<const uint64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Places = nb::ndarray<const int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

nb::typed<nb::tuple, Out<double>, Out<int64_t>> fly(const std::vector<const Plan *> &plans,
                                                    const Places &which, const Numbers &numbers,
                                                    std::optional<std::string> instructions,
                                                    size_t threads)
{
  const size_t count = which.size();
  same_length(count, numbers.size(), "numbers");
  for (size_t i = 0; i < count; i++)
    if (which.data()[i] < 0 || static_cast<size_t>(which.data()[i]) >= plans.size())
      throw std::invalid_argument("which must be places of plans");
  const amb_instructions set = chosen(instructions);
  const size_t lanes = set == AMB_SCALAR ? 1 : amb_batch_lanes(set);
  const auto work = chunks(plans, which.data(), count, lanes);
  Fresh<double> figures({count, AMB_FIGURES});
  Fresh<int64_t> flags({count, AMB_FLAGS});
  const auto fly_together = [&](size_t at) {
    const std::vector<size_t> &places = work[at];
    std::vector<amb_many_run> runs;
    std::vector<amb_many_run *> pointers;
    std::vector<std::vector<std::max_align_t>> states;
    runs.reserve(places.size());
    for (const size_t i : places) {
      const Plan &plan = *plans[static_cast<size_t>(which.data()[i])];
      states.emplace_back(plan.memory());
      runs.push_back(plan.run);
      runs.back().key.run = numbers.data()[i];
      runs.back().estimator = states.back().data();
      if (plan.closed_loop.estimator != nullptr)
        plan.reset(states.back().data());
      plan.closed_loop.settle(runs.back().state, states.back().data());
      pointers.push_back(&runs.back());
    }
    const Plan &first = *plans[static_cast<size_t>(which.data()[places[0]])];
    if (lanes > 1 && amb_many_group(&first.run) != 0U) {
      amb_many_advance(set, pointers.data(), pointers.size(), first.closed_loop.in.n);
    } else {
      Room room(first);
      amb_many_one(pointers[0], room.noise_u.data(), room.noise_y.data(), room.touched.data(),
                   &room.to);
    }
    for (size_t k = 0; k < places.size(); k++) {
      std::copy_n(runs[k].figures, AMB_FIGURES, figures.data + places[k] * AMB_FIGURES);
      std::copy_n(runs[k].flags, AMB_FLAGS, flags.data + places[k] * AMB_FLAGS);
    }
  };
  bool done = false;
  {
    nb::gil_scoped_release release;
    done = work_off(work.size(), threads, fly_together);
  }
  if (!done)
    nb::raise_python_error();
  return nb::make_tuple(figures.array, flags.array);
}

Out<double> normal_noise(uint64_t seed, uint64_t run, uint32_t stream, size_t n)
{
  Fresh<double> noise({n});
  {
    nb::gil_scoped_release release;
    amb_many_noise({seed, run}, stream, 0, n, noise.data);
  }
  return noise.array;
}

Out<uint32_t> philox(const std::vector<uint32_t> &counter, const std::vector<uint32_t> &key)
{
  same_length(4, counter.size(), "counter");
  same_length(2, key.size(), "key");
  Fresh<uint32_t> random({4});
  amb_philox(counter.data(), key.data(), random.data);
  return random.array;
}

} // namespace

void bind_many(nb::module_ &m)
{
  nb::class_<Along>(m, "Along", "What an estimator knows of each axis, by its states.")
      .def(nb::init<const Tables &, size_t, size_t>(), nb::arg("rows"), nb::arg("axes"),
           nb::arg("states"));
  nb::class_<Plan>(m, "Plan", "A closed loop that is run many times, all but its number.")
      .def(
          nb::init<const nb::dict &, const nb::kwargs &>(), nb::arg("loop"), nb::arg("named"),
          nb::sig("def __init__(self, loop: dict[str, Any], *, seed: int, std_u: list[float], "
                  "std_y: list[float], noise_u: Any, noise_y: Any, windows: Any, mean: Any, "
                  "std: Any, along: Along | None, **named: Any) -> None"),
          "What `simulate` is named, and what sim/many.h has beside: noise, windows (axes, 7), and "
          "an estimator's start and rows along the axes.");
  m.def(
      "fly", &fly, nb::arg("plans"), nb::arg("which"), nb::arg("numbers"), nb::kw_only(),
      nb::arg("instructions") = nb::none(), nb::arg("threads") = 1,
      "Runs (runs,) of plans with these numbers: figures (runs, 20), counts of flags (runs, 15).");
  m.def("normal_noise", &normal_noise, nb::arg("seed"), nb::arg("run"), nb::arg("stream"),
        nb::arg("n"), "Standard normal noise (n,) of these counters; see sim/many.h.");
  m.def("philox", &philox, nb::arg("counter"), nb::arg("key"),
        "Philox 4x32-10: four words of a counter (4,) and a key (2,) made random (4,).");
}
