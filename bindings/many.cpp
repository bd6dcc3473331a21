// Many closed loops, judged while they run: SIMD lanes (sim/many.h) and threads.
#include "loop_of.h"
#include "work.h"

#include <map>

extern "C" {
#include "many.h"
}

namespace
{

using Doubles = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// All of a run but its number: loop, start, and what comes from outside. Python keeps magnets and
// estimator alive, and the arrays are kept here.
struct Plan {
  LoopOf of;
  Estimator *estimator;
  amb_many_run run{};
  size_t n;
  std::vector<amb_real> mean, std;
  Vector place, current, integral;
  bool hovers;
  Vector r, load;
  std::optional<Doubles> noise_u, noise_y;
  std::optional<Vector> scale, fly;
  std::optional<Faults> faults;

  Plan(const Named &loop, Estimator *estimator_, Control *control, std::optional<Vector> at_mean,
       std::optional<Vector> at_std, Vector place_, Vector current_, Vector integral_, bool hovers_,
       Vector reference, Vector load_, uint64_t seed, double std_u, double std_y,
       std::optional<Doubles> on_u, std::optional<Doubles> on_y, std::optional<Vector> scaled,
       const std::optional<Named> &wrong, bool beside, std::optional<Vector> flies, size_t first,
       size_t step_from, size_t step_to, amb_real height, size_t load_from, amb_real band)
      : of(loop, estimator_, control), estimator(estimator_), n(reference.size()), place(place_),
        current(current_), integral(integral_), hovers(hovers_), r(reference), load(load_),
        noise_u(on_u), noise_y(on_y), scale(scaled), fly(flies)
  {
    same_length(1, of.axes(), "a loop that is judged, in axes,");
    of.check_start(place, current, integral);
    same_length(n, load.size(), "load");
    for (const auto &[array, name] : {std::pair{&noise_u, "noise_u"}, {&noise_y, "noise_y"}})
      if (*array)
        same_length(n, (*array)->size(), name);
    if (scale)
      same_length(n, scale->size(), "scale");
    if (fly)
      same_length(n, fly->size(), "fly");
    if (wrong)
      faults.emplace(*wrong, beside, n, of);
    if (estimator != nullptr) {
      estimator->must_have({AMB_POSITION, AMB_VELOCITY, AMB_LOAD}, "a loop that is judged");
      if (!at_mean || !at_std)
        throw std::invalid_argument("an estimator needs a mean and an std to start from");
      same_length(estimator->sizes().states, at_mean->size(), "mean");
      same_length(estimator->sizes().states, at_std->size(), "std");
      mean = copied(*at_mean);
      std = copied(*at_std);
    }
    if (first >= n || step_to > n || load_from > n)
      throw std::invalid_argument("spans must be within the run");
    run.loop = &of.loop;
    run.in.n = run.in.off = n;
    run.in.r = r.data();
    run.in.load = load.data();
    run.key = {seed, 0};
    run.std_u = std_u;
    run.std_y = std_y;
    run.noise_u = noise_u ? noise_u->data() : nullptr;
    run.noise_y = noise_y ? noise_y->data() : nullptr;
    run.in.scale = scale ? scale->data() : nullptr;
    run.in.faults = faults ? &faults->to : nullptr;
    run.in.fly = fly ? fly->data() : nullptr;
    const bool steps = step_from < step_to;
    run.windows = {static_cast<double>(first),
                   static_cast<double>(step_from),
                   static_cast<double>(step_to),
                   steps ? height : 1.0,
                   steps ? r.data()[step_from] : 0.0,
                   static_cast<double>(load_from),
                   band};
    if (estimator != nullptr) {
      std::vector<std::max_align_t> tried(memory());
      if (!reset(tried.data()))
        throw std::invalid_argument("mean must be finite, std finite and positive");
    }
  }
  Plan(const Plan &) = delete; // `run` points into the object

  // Of an estimator's state, in units of the greatest alignment.
  size_t memory() const
  {
    return estimator ? of.loop.estimator->methods->state_size / sizeof(std::max_align_t) + 1 : 0;
  }
  bool reset(void *state) const
  {
    const amb_estimator *e = of.loop.estimator;
    return e->methods->reset(e, state, mean.data(), std.data()) == AMB_OK;
  }
};

// Room for the samples of one run at a time.
class Room
{
public:
  amb_loop_output to{};
  std::vector<amb_real> noise_u, noise_y;
  std::vector<unsigned char> touched;

  explicit Room(const Plan &plan) : noise_u(plan.n), noise_y(plan.n), touched(plan.n)
  {
    const size_t n = plan.n;
    const Sizes of(plan.estimator ? plan.estimator->kf.model : amb_model{});
    signals.resize(n * (7 + of.states + 2 * of.sensors + 2 * of.forces + 2));
    flags.resize(n * (1 + of.sensors));
    amb_real *next = signals.data();
    const auto place = [&next, n](size_t columns) {
      amb_real *here = next;
      next += n * columns;
      return here;
    };
    for (amb_real **each : {&X[0], &X[1], &X[2], &to.iu, &to.force, &to.y, &to.u})
      *each = place(1);
    to.X = X;
    to.columns = 3;
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
  amb_real *X[3];
  std::vector<unsigned short> flags;
};

// Runs that go side by side, by their places: alike, and in their order.
std::vector<std::vector<size_t>> chunks(const std::vector<const Plan *> &plans,
                                        const int64_t *which, size_t count, size_t lanes)
{
  std::vector<std::pair<unsigned int, size_t>> alike;
  for (const Plan *plan : plans)
    alike.emplace_back(lanes > 1 ? amb_many_group(&plan->run) : 0U, plan->n);
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
    std::vector<amb_many_run *> each;
    std::vector<std::vector<std::max_align_t>> states;
    runs.reserve(places.size());
    for (const size_t i : places) {
      const Plan &plan = *plans[static_cast<size_t>(which.data()[i])];
      states.emplace_back(plan.memory());
      runs.push_back(plan.run);
      runs.back().key.run = numbers.data()[i];
      runs.back().estimator = states.back().data();
      if (plan.estimator != nullptr)
        plan.reset(states.back().data());
      plan.of.settle(runs.back().state, plan.place, plan.current, plan.integral, plan.hovers,
                     states.back().data());
      each.push_back(&runs.back());
    }
    const Plan &first = *plans[static_cast<size_t>(which.data()[places[0]])];
    if (lanes > 1 && amb_many_group(&first.run) != 0U) {
      amb_many_advance(set, each.data(), each.size(), first.n);
    } else {
      Room room(first);
      amb_many_alone(each[0], room.noise_u.data(), room.noise_y.data(), room.touched.data(),
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
  nb::class_<Plan>(m, "Plan", "A closed loop that is run many times, all but its number.")
      .def(nb::init<const Named &, Estimator *, Control *, std::optional<Vector>,
                    std::optional<Vector>, Vector, Vector, Vector, bool, Vector, Vector, uint64_t,
                    double, double, std::optional<Doubles>, std::optional<Doubles>,
                    std::optional<Vector>, const std::optional<Named> &, bool,
                    std::optional<Vector>, size_t, size_t, size_t, amb_real, size_t, amb_real>(),
           nb::arg("loop"), nb::kw_only(), nb::arg("estimator").none(), nb::arg("control").none(),
           nb::arg("mean").none(), nb::arg("std").none(), nb::arg("place"), nb::arg("current"),
           nb::arg("integral"), nb::arg("hovers"), nb::arg("r"), nb::arg("load"), nb::arg("seed"),
           nb::arg("std_u"), nb::arg("std_y"), nb::arg("noise_u").none(), nb::arg("noise_y").none(),
           nb::arg("scale").none(), nb::arg("faults").none(), nb::arg("beside"),
           nb::arg("fly").none(), nb::arg("first"), nb::arg("step_from"), nb::arg("step_to"),
           nb::arg("height"), nb::arg("load_from"), nb::arg("band"), nb::keep_alive<1, 3>(),
           nb::keep_alive<1, 4>(), "See sim/many.h for shapes and units.");
  m.def(
      "fly", &fly, nb::arg("plans"), nb::arg("which"), nb::arg("numbers"), nb::kw_only(),
      nb::arg("instructions") = nb::none(), nb::arg("threads") = 1,
      "Runs (runs,) of plans with these numbers: figures (runs, 18), counts of flags (runs, 12).");
  m.def("normal_noise", &normal_noise, nb::arg("seed"), nb::arg("run"), nb::arg("stream"),
        nb::arg("n"), "Standard normal noise (n,) of these counters; see sim/noise.h.");
  m.def("philox", &philox, nb::arg("counter"), nb::arg("key"),
        "Philox 4x32-10: four words of a counter (4,) and a key (2,) made random (4,).");
}
