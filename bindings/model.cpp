// The model of a machine: the built-in one from its parameters, or any from its arrays.
#include "estimator.h"

#include <nanobind/stl/vector.h>

#include <algorithm>

#if defined(AMB_MODEL_LOOPS)

amb_sparse Model::sparse(const nb::dict &arrays, const char *name, size_t rows, size_t columns)
{
  const std::string of(name);
  const auto given = nb::cast<nb::tuple>(arrays[name]); // start, column, value
  const auto start = nb::cast<std::vector<unsigned short>>(given[0]);
  const auto column = nb::cast<std::vector<unsigned short>>(given[1]);
  const auto value = nb::cast<std::vector<amb_real>>(given[2]);
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
  numbers.push_back(value);
  return {rows_start, of_entries, numbers.back().data()};
}

const amb_real *Model::values(const nb::dict &arrays, const char *name, size_t count)
{
  const auto value = nb::cast<std::vector<amb_real>>(arrays[name]);
  same_length(count, value.size(), name);
  numbers.push_back(value);
  return numbers.back().data();
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
  model.e = values(arrays, "e", model.h.start[p]);
  model.r = values(arrays, "r", model.h.start[p]);
  model.d = sparse(arrays, "d", p, c);
  model.c = sparse(arrays, "c", m, n);
  model.N = sparse(arrays, "N", noises, n * (n + 1) / 2);
  model.rest = sparse(arrays, "rest", n, n);
  for (const amb_real role : nb::cast<std::vector<amb_real>>(arrays["role"]))
    roles.push_back(static_cast<unsigned char>(role));
  same_length(n, roles.size(), "role");
  model.role = roles.data();
}

void Model::nodes(amb_real first, amb_real step, const nb::list &arrays_at, const nb::list &growing)
{
  const std::vector<amb_real> &L = numbers.front();
  if (nb::len(arrays_at) < 4 || !(step > 0))
    throw std::invalid_argument("a model turns between four speeds or more, one after the other");
  std::vector<std::vector<std::vector<amb_real>>> found;
  for (const auto each : arrays_at) {
    const Model there(nb::cast<nb::dict>(each));
    if (there.places != places)
      throw std::invalid_argument("models at different speeds must have one pattern");
    found.push_back(there.numbers);
  }
  const auto more = nb::cast<std::vector<std::vector<amb_real>>>(growing);
  same_length(found.size(), more.size(), "growing");
  for (const auto &each : more)
    same_length(L.size(), each.size(), "growing, its entries of L,");
  growing_at = more;
  first_node = first;
  node_step = step;
  at_nodes = std::move(found);
}

void Model::turn(amb_real speed, amb_real growth)
{
  const auto last = static_cast<amb_real>(at_nodes.size() - 1);
  const amb_real at = std::clamp((speed - first_node) / node_step, amb_real(0), last);
  const auto k = static_cast<size_t>(std::clamp(at - 1, amb_real(0), last - 3));
  const amb_real x = at - static_cast<amb_real>(k); // of the nodes 0, 1, 2, 3
  const amb_real w[4] = {(x - 1) * (x - 2) * (3 - x) / 6, x * (x - 2) * (x - 3) / 2,
                         x * (x - 1) * (3 - x) / 2, x * (x - 1) * (x - 2) / 6};
  for (size_t a = 0; a < numbers.size(); a++)
    for (size_t i = 0; i < numbers[a].size(); i++)
      numbers[a][i] = w[0] * at_nodes[k][a][i] + w[1] * at_nodes[k + 1][a][i] +
                      w[2] * at_nodes[k + 2][a][i] + w[3] * at_nodes[k + 3][a][i];
  std::vector<amb_real> &L = numbers.front();
  for (size_t i = 0; i < L.size(); i++)
    L[i] += growth * (w[0] * growing_at[k][i] + w[1] * growing_at[k + 1][i] +
                      w[2] * growing_at[k + 2][i] + w[3] * growing_at[k + 3][i]);
}

void Model::stand(const nb::dict &arrays)
{
  const Model there(arrays);
  if (there.places != places)
    throw std::invalid_argument("a model stands as it was made: with one pattern");
  for (size_t a = 0; a < numbers.size(); a++) // in place, as the core's model points there
    std::copy(there.numbers[a].begin(), there.numbers[a].end(), numbers[a].begin());
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
      .def("nodes", &Model::nodes, nb::arg("first"), nb::arg("step"), nb::arg("arrays"),
           nb::arg("growing"),
           nb::sig("def nodes(self, first: float, step: float, arrays: list[dict[str, Any]], "
                   "growing: list[list[float]]) -> None"),
           "The same machine at speeds one after the other [rad/s], and what the entries of L gain "
           "there for each rad/s^2 by which the speed grows; then it can turn.")
      .def("turn", &Model::turn, nb::arg("speed"), nb::arg("growth"),
           "Take the numbers of a speed [rad/s] that grows [rad/s^2].");
  m.attr("MOST_STATES") = AMB_STATES;
  m.attr("MOST_FORCES") = AMB_FORCES;
  m.attr("MOST_SENSORS") = AMB_SENSORS;
}

#else

extern "C" {
#include "generated/axial_fields.h"
}

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
