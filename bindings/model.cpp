// The model of a machine: the built-in one from its parameters, or any from its arrays.
#include "estimator.h"

#include <nanobind/stl/vector.h>

#include <algorithm>

#if defined(AMB_MODEL_LOOPS)

amb_sparse Model::sparse(const nb::dict &arrays, const char *name, size_t rows, size_t columns)
{
  const std::string of(name);
  const auto sparse = nb::cast<nb::tuple>(arrays[name]); // start, column, value
  const auto start = nb::cast<std::vector<unsigned short>>(sparse[0]);
  const auto column = nb::cast<std::vector<unsigned short>>(sparse[1]);
  const auto value = nb::cast<std::vector<amb_real>>(sparse[2]);
  same_length(rows + 1, start.size(), (of + ", where its rows start,").c_str());
  same_length(start.back(), column.size(), (of + ", its columns,").c_str());
  same_length(start.back(), value.size(), name);
  for (size_t i = 0; i < rows; i++)
    for (size_t k = start[i]; k < start[i + 1]; k++)
      if (start[i + 1] < start[i] || column[k] >= columns ||
          (k > start[i] && column[k] <= column[k - 1]))
        throw std::invalid_argument(of + ": columns of a row must ascend, and be there");
  places.push_back(start);
  const unsigned short *rows_start = places.back().data();
  places.push_back(column);
  const unsigned short *of_entries = places.back().data();
  loose.push_back(value);
  return {rows_start, of_entries, nullptr}; // `gather` sets the pointer
}

void Model::values(const nb::dict &arrays, const char *name, size_t count)
{
  const auto value = nb::cast<std::vector<amb_real>>(arrays[name]);
  same_length(count, value.size(), name);
  loose.push_back(value);
}

Model::Model(const nb::dict &arrays)
{
  const auto count = [&](const char *name, size_t most) {
    const auto n = nb::cast<size_t>(arrays[name]);
    if (n < 1 || n > most)
      throw std::invalid_argument("a model has 1 to " + std::to_string(most) + " " + name +
                                  ", got " + std::to_string(n));
    return n;
  };
  const size_t n = count("states", AMB_STATES), p = count("forces", AMB_FORCES);
  const size_t c = count("controls", AMB_CONTROLS), m = count("sensors", AMB_SENSORS);
  const size_t noises = count("noises", AMB_NOISES);
  model.states = static_cast<int>(n);
  model.forces = static_cast<int>(p);
  model.controls = static_cast<int>(c);
  model.sensors = static_cast<int>(m);
  model.noises = static_cast<int>(noises);
  model.L = sparse(arrays, "L", n, n);
  model.b = sparse(arrays, "b", n, p);
  model.B_u = sparse(arrays, "B_u", n, c);
  model.h = sparse(arrays, "h", p, n);
  values(arrays, "e", model.h.start[p]);
  values(arrays, "r", model.h.start[p]);
  model.d = sparse(arrays, "d", p, c);
  model.c = sparse(arrays, "c", m, n);
  model.N = sparse(arrays, "N", noises, n * (n + 1) / 2);
  model.rest = sparse(arrays, "rest", n, n);
  for (const amb_real role : nb::cast<std::vector<amb_real>>(arrays["role"]))
    roles.push_back(static_cast<unsigned char>(role));
  same_length(n, roles.size(), "role");
  model.role = roles.data();
  gather();
}

void Model::gather()
{
  size_t count = 0;
  for (const auto &item : loose)
    count += item.size();
  numbers.reserve(count);
  const amb_real **values[] = {&model.L.value, &model.b.value,   &model.B_u.value, &model.h.value,
                               &model.e,       &model.r,         &model.d.value,   &model.c.value,
                               &model.N.value, &model.rest.value};
  for (size_t k = 0; k < loose.size(); k++) {
    *values[k] = numbers.data() + numbers.size();
    numbers.insert(numbers.end(), loose[k].begin(), loose[k].end());
  }
  loose.clear();
}

void Model::nodes(int lowest, amb_real step, const Vector &still, const Places &which,
                  const Matrix &at, const Places &grown, const Matrix &by_growth)
{
  same_length(numbers.size(), still.size(), "still");
  same_length(which.size(), at.shape(1), "at, its numbers,");
  same_length(grown.size(), by_growth.shape(1), "by_growth, its numbers,");
  same_length(at.shape(0), by_growth.shape(0), "by_growth, its nodes,");
  if (at.shape(0) < 4 || !(step > 0))
    throw std::invalid_argument("a model turns between four speeds or more, one after the other");
  for (const Places *places_of : {&which, &grown})
    for (size_t i = 0; i < places_of->size(); i++)
      if (places_of->data()[i] >= numbers.size())
        throw std::invalid_argument("a number that the speed changes is none of the model's");
  kept_which.assign(which.data(), which.data() + which.size());
  kept_grown.assign(grown.data(), grown.data() + grown.size());
  kept_at = {at.data(), at.data() + at.size()};
  kept_by_growth = {by_growth.data(), by_growth.data() + by_growth.size()};
  std::copy_n(still.data(), numbers.size(), numbers.data()); // independent of the present speed
  turning = {static_cast<int>(at.shape(0)),
             static_cast<int>(numbers.size()),
             static_cast<int>(which.size()),
             static_cast<int>(grown.size()),
             lowest,
             step,
             numbers.data(),
             kept_which.data(),
             kept_at.data(),
             kept_grown.data(),
             kept_by_growth.data()};
}

void Model::turn(amb_real speed, amb_real growth)
{
  amb_turning_to(&turning, speed, growth, numbers.data());
}

void Model::synchronous(const nb::dict &arguments)
{
  const auto within = [](int at, int count) {
    if (at < 0 || at >= count)
      throw std::invalid_argument("a synchronous state is none of the model's");
    return at;
  };
  error = {within(nb::cast<int>(arguments["state"]), model.states),
           within(nb::cast<int>(arguments["noise"]), model.noises),
           0,
           nullptr,
           nullptr,
           nb::cast<bool>(arguments["reverses"])};
  direction = {};
  starts = nb::cast<std::vector<amb_real>>(arguments["std"]);
  same_length(static_cast<size_t>(model.states), starts.size(), "std");
  pairs.clear();
  for (const auto item : nb::cast<nb::list>(arguments["pair"])) {
    const auto pair = nb::cast<nb::dict>(item);
    pairs.push_back({within(nb::cast<int>(pair["state"]), model.states - 1),
                     within(nb::cast<int>(pair["noise"]), model.noises),
                     nb::cast<amb_real>(pair["order"]), nb::cast<amb_real>(pair["power"]),
                     nb::cast<amb_real>(pair["usual"]), nb::cast<amb_real>(pair["vague"])});
  }
  error.pairs = static_cast<int>(pairs.size());
  error.pair = pairs.data();
  error.std = starts.data();
}

amb_real Model::by(amb_kalman &kf, amb_kalman_state &state, const amb_real fields[])
{
  const amb_rotation rotation = {fields[0], fields[1],     fields[2],     fields[3],
                                 fields[4], fields[5] > 0, fields[6] > 0, fields[7],
                                 fields[8], fields[9],     fields[10]};
  return amb_rotate(&turning, &error, &kf, &state, numbers.data(), &direction, &rotation);
}

void Model::stand(const Vector &still)
{
  same_length(numbers.size(), still.size(), "still");
  // in place, because the core points there
  std::copy_n(still.data(), numbers.size(), numbers.data());
}

nb::dict shown(const amb_model &)
{
  return {};
}

void bind_model(nb::module_ &m)
{
  nb::class_<Model>(m, "Model", "Any model (ambkit/loops.h).")
      .def(nb::init<const nb::dict &>(), nb::arg("arrays"),
           nb::sig("def __init__(self, arrays: dict[str, Any]) -> None"))
      .def("nodes", &Model::nodes, nb::arg("lowest"), nb::arg("step"), nb::arg("still"),
           nb::arg("which"), nb::arg("at"), nb::arg("grown"), nb::arg("by_growth"),
           nb::sig("def nodes(self, lowest: int, step: float, still: Any, which: Any, at: Any, "
                   "grown: Any, by_growth: Any) -> None"),
           "The numbers that a speed changes, at speeds one after the other, and what they gain "
           "there by its growth (ambkit/turning.h); then the model can turn.")
      .def("synchronous", &Model::synchronous, nb::arg("arguments"),
           nb::sig("def synchronous(self, arguments: dict[str, Any]) -> None"),
           "The states that turn with the rotor, and the error of its speed.")
      .def("turn", &Model::turn, nb::arg("speed"), nb::arg("growth"),
           "Take the numbers of a speed [rad/s] that grows [rad/s^2].");
  m.attr("MOST_STATES") = AMB_STATES;
  m.attr("MOST_FORCES") = AMB_FORCES;
  m.attr("MOST_SENSORS") = AMB_SENSORS;
}

#else

#include "axial_fields.h"

Model::Model(amb_real T, amb_real m, amb_real K_sen, amb_real T_sen, bool as_printed)
{
  if (!(amb_is_positive(T) && amb_is_positive(m) && amb_is_finite(K_sen) &&
        amb_is_positive(amb_magnitude(K_sen)) && amb_is_positive(T_sen)))
    throw std::invalid_argument("T, m and T_sen must be positive, K_sen not 0");
  amb_model_init(&model, T, m, K_sen, T_sen);
  if (as_printed)
    amb_model_as_printed(&model);
}

nb::dict shown(const amb_model &model)
{
  nb::dict all;
#define SHOW(field) all[#field] = model.field
  AMB_MODEL_FIELDS(SHOW);
#undef SHOW
  return all;
}

void bind_model(nb::module_ &m)
{
  nb::class_<Model>(m, "Model", "The paper's axis, four states (core/generated/axial.h).")
      .def(nb::init<amb_real, amb_real, amb_real, amb_real, bool>(), nb::arg("T"), nb::arg("m"),
           nb::arg("K_sen"), nb::arg("T_sen"), nb::arg("as_printed"));
}

#endif
