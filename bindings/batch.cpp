// Many estimators along many records: SIMD lanes (sim/batch.h) and threads.
#include "estimator.h"
#include "work.h"

#include <map>

namespace
{

nb::list instruction_sets()
{
  nb::list sets;
  for (int i = AMB_SCALAR; i <= AMB_AVX512; i++)
    if (amb_batch_has(static_cast<amb_instructions>(i)))
      sets.append(INSTRUCTIONS[i]);
  return sets;
}

using Rows = nb::ndarray<const amb_real, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Cube = nb::ndarray<const amb_real, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
template <typename T> using To = nb::ndarray<T, nb::c_contig, nb::device::cpu>;

// Start of run i in an array with one row for all runs, or a row for each.
template <typename Array> auto row(const Array &a, size_t i, size_t runs, size_t width)
{
  if (a.shape(0) != 1 && a.shape(0) != runs)
    throw std::invalid_argument("an array has " + std::to_string(a.shape(0)) + " rows for " +
                                std::to_string(runs) + " runs");
  return a.data() + (a.shape(0) == 1 ? 0 : i * width);
}

template <typename T>
T *place(const std::optional<To<T>> &a, size_t i, size_t runs, size_t width, const char *name)
{
  if (!a)
    return nullptr;
  if (a->size() != runs * width)
    throw std::invalid_argument(std::string(name) + " has another size than the runs");
  return a->data() + i * width;
}

// Chunks of runs that go side by side: of the same group, in their order.
std::vector<std::vector<amb_batch_run *>> chunks(std::vector<amb_batch_run> &runs, size_t lanes)
{
  std::map<unsigned int, std::vector<amb_batch_run *>> waiting;
  std::vector<std::vector<amb_batch_run *>> full;
  for (amb_batch_run &run : runs) {
    const unsigned int group = amb_batch_group(run.estimator);
    auto &chunk = waiting[group];
    chunk.push_back(&run);
    if (group == 0 || chunk.size() == lanes) {
      full.push_back(std::move(chunk));
      chunk.clear();
    }
  }
  for (auto &[group, chunk] : waiting)
    if (!chunk.empty())
      full.push_back(std::move(chunk));
  return full;
}

nb::typed<nb::tuple, Out<double>, Out<unsigned int>>
run_batch(const std::vector<const Estimator *> &estimators, const Rows &y, const Rows &u,
          const Rows &mean, const Rows &std, std::optional<Cube> truth, size_t skip,
          std::optional<To<amb_real>> means, std::optional<To<amb_real>> innovation,
          std::optional<To<amb_real>> variance, std::optional<To<unsigned short>> status,
          std::optional<std::string> instructions, size_t threads)
{
  const size_t n = y.shape(1), count = mean.shape(0);
  const amb_instructions set = chosen(instructions);
  same_length(n, u.shape(1), "u");
  if (estimators.empty())
    throw std::invalid_argument("there must be an estimator");
  const Sizes of = estimators[0]->sizes();
  if (of.sensors != 1 || of.controls != 1)
    throw std::invalid_argument("only models of one sensor and one control can be run in batches");
  if (mean.shape(1) != of.states || std.shape(1) != of.states)
    throw std::invalid_argument("mean and std must have " + std::to_string(of.states) + " columns");
  if (truth && (truth->shape(1) != n || truth->shape(2) != AMB_BATCH_JUDGED))
    throw std::invalid_argument("truth must be (runs, n, 3)");
  if (estimators.size() != 1)
    same_length(count, estimators.size(), "estimators");
  std::vector<std::vector<std::max_align_t>> states(count);
  std::vector<amb_batch_run> runs(count);
  for (size_t i = 0; i < count; i++) {
    const amb_estimator *e = &estimators[estimators.size() == 1 ? 0 : i]->estimator;
    same_length(of.states, amb_states(&e->kf->model), "an estimator's state");
    states[i].resize(e->methods->state_size / sizeof(std::max_align_t) + 1);
    runs[i] = {e,
               states[i].data(),
               row(y, i, count, n),
               row(u, i, count, n),
               truth ? row(*truth, i, count, n * AMB_BATCH_JUDGED) : nullptr,
               place(means, i, count, n * of.states, "means"),
               place(innovation, i, count, n, "innovation"),
               place(variance, i, count, n, "variance"),
               place(status, i, count, n, "status"),
               {0, 0, 0},
               AMB_OK};
    if (e->methods->reset(e, states[i].data(), row(mean, i, count, of.states),
                          row(std, i, count, of.states)) != AMB_OK)
      throw std::invalid_argument("mean must be finite, std finite and positive");
  }
  const auto work = chunks(runs, amb_batch_lanes(set));
  bool done = false;
  {
    nb::gil_scoped_release release;
    done = work_off(work.size(), threads, [&](size_t i) {
      amb_batch_advance(set, work[i].data(), work[i].size(), n, skip);
    });
  }
  if (!done)
    nb::raise_python_error();
  Fresh<double> squares({count, AMB_BATCH_JUDGED});
  Fresh<unsigned int> all({count});
  for (size_t i = 0; i < count; i++) {
    std::copy_n(runs[i].squares, AMB_BATCH_JUDGED, squares.data + i * AMB_BATCH_JUDGED);
    all.data[i] = runs[i].all;
  }
  return nb::make_tuple(squares.array, all.array);
}

} // namespace

void bind_batch(nb::module_ &m)
{
  m.def("instruction_sets", &instruction_sets, nb::sig("def instruction_sets() -> list[str]"),
        "What this processor can compute lanes with, the fastest last.");
  m.def(
      "run_batch", &run_batch, nb::arg("estimators"), nb::arg("y"), nb::arg("u"), nb::arg("mean"),
      nb::arg("std"), nb::kw_only(), nb::arg("truth") = nb::none(), nb::arg("skip") = 0,
      nb::arg("means") = nb::none(), nb::arg("innovation") = nb::none(),
      nb::arg("variance") = nb::none(), nb::arg("status") = nb::none(),
      nb::arg("instructions") = nb::none(), nb::arg("threads") = 1,
      "Many runs side by side (sim/batch.h), each from its start mean, std (runs, 4). Arrays that "
      "are given are filled. Returns sums of squared errors (runs, 3) and flags (runs,).");
}
