#include "laws.h"

#include <algorithm>
#include <nanobind/stl/string.h>

extern "C" {
#include "ambkit/phi.h"
}

namespace
{

struct Constant : Magnet {
  amb_stiffness k;
  Constant(amb_real k_i, amb_real k_s) : k{k_i, k_s}
  {
    magnet = {&amb_constant_magnet, &k};
  }
  InC in_c() const override
  {
    return {"amb_stiffness", "amb_constant_magnet", "magnet", "constant stiffnesses"};
  }
  Named parameters() const override
  {
    nb::dict d;
    d["k_i"] = k.k_i;
    d["k_s"] = k.k_s;
    return d;
  }
};

struct Law : Magnet {
  const LawInCore *of = nullptr;
  std::vector<std::max_align_t> room; // the struct
  char *at(size_t offset)
  {
    return reinterpret_cast<char *>(room.data()) + offset;
  }
  const char *at(size_t offset) const
  {
    return reinterpret_cast<const char *>(room.data()) + offset;
  }
  Law(const std::string &name, const nb::kwargs &fields)
  {
    for (const LawInCore &law : of_laws)
      if (name == law.name)
        of = &law;
    if (of == nullptr)
      throw std::invalid_argument("the core was built without the force law " + name);
    if (fields.size() != of->fields.size())
      throw std::invalid_argument("the law " + name + " has " + std::to_string(of->fields.size()) +
                                  " fields, got " + std::to_string(fields.size()));
    room.resize(of->size / sizeof(std::max_align_t) + 1);
    for (const LawInCore::Field &field : of->fields)
      if (field.is_bool)
        new (at(field.offset)) bool(nb::cast<bool>(fields[field.name]));
      else
        new (at(field.offset)) amb_real(nb::cast<amb_real>(fields[field.name]));
    magnet = {of->methods, room.data()};
  }
  Named parameters() const override
  {
    nb::dict d;
    for (const LawInCore::Field &field : of->fields)
      if (field.is_bool)
        d[field.name] = *reinterpret_cast<const bool *>(at(field.offset));
      else
        d[field.name] = *reinterpret_cast<const amb_real *>(at(field.offset));
    return d;
  }
  InC in_c() const override
  {
    return of->in_c;
  }
};

struct Table : Magnet {
  std::vector<amb_stiffness> nodes;
  amb_table table{};
  Table(amb_real x_min, amb_real dx, amb_real iu_min, amb_real diu, const Matrix &ki,
        const Matrix &ks)
  {
    if (ki.shape(0) != ks.shape(0) || ki.shape(1) != ks.shape(1))
      throw std::invalid_argument("k_i and k_s differ in shape");
    if (ki.shape(0) < 2 || ki.shape(1) < 2)
      throw std::invalid_argument("a table needs at least 2 x 2 nodes");
    for (size_t k = 0; k < ki.size(); k++)
      nodes.push_back({ki.data()[k], ks.data()[k]});
    table = {static_cast<int>(ki.shape(0)),
             static_cast<int>(ki.shape(1)),
             static_cast<amb_real>(ki.shape(0) - 1),
             static_cast<amb_real>(ki.shape(1) - 1),
             x_min,
             1 / dx,
             iu_min,
             1 / diu,
             nodes.data()};
    magnet = {&amb_table_magnet, &table};
  }

  InC in_c() const override
  {
    return {"amb_table", "amb_table_magnet", "table", "bilinear stiffness tables"};
  }
  Named parameters() const override
  {
    Fresh<amb_real> pairs({nodes.size(), 2});
    for (size_t k = 0; k < nodes.size(); k++) {
      pairs.data[2 * k] = nodes[k].k_i;
      pairs.data[2 * k + 1] = nodes[k].k_s;
    }
    nb::dict d;
    d["rows"] = table.rows;
    d["columns"] = table.columns;
    d["last_row"] = table.last_row;
    d["last_column"] = table.last_column;
    d["x_min"] = table.x_min;
    d["per_metre"] = table.per_metre;
    d["iu_min"] = table.iu_min;
    d["per_ampere"] = table.per_ampere;
    d["nodes"] = pairs.array;
    return d;
  }
};

struct Surface : Magnet {
  std::vector<amb_force_node> nodes;
  amb_surface surface{};
  Surface(amb_real x_min, amb_real dx, amb_real iu_min, amb_real diu, const Matrix &f,
          const Matrix &f_i, const Matrix &f_x, const Matrix &f_ix, amb_real ampere, amb_real metre)
  {
    for (const Matrix *a : {&f_i, &f_x, &f_ix})
      if (a->shape(0) != f.shape(0) || a->shape(1) != f.shape(1))
        throw std::invalid_argument("force and derivatives differ in shape");
    if (f.shape(0) < 2 || f.shape(1) < 2)
      throw std::invalid_argument("a surface needs at least 2 x 2 nodes");
    for (size_t k = 0; k < f.size(); k++)
      nodes.push_back({f.data()[k], f_i.data()[k], f_x.data()[k], f_ix.data()[k]});
    surface = {static_cast<int>(f.shape(0)),
               static_cast<int>(f.shape(1)),
               static_cast<amb_real>(f.shape(0) - 1),
               static_cast<amb_real>(f.shape(1) - 1),
               x_min,
               dx,
               1 / dx,
               iu_min,
               diu,
               1 / diu,
               ampere,
               metre,
               nodes.data()};
    magnet = {&amb_surface_magnet, &surface};
  }

  InC in_c() const override
  {
    return {"amb_surface", "amb_surface_magnet", "surface", "a smooth force map"};
  }
  Named parameters() const override
  {
    Fresh<amb_real> rows({nodes.size(), 4});
    for (size_t k = 0; k < nodes.size(); k++) {
      const amb_real of[] = {nodes[k].f, nodes[k].f_i, nodes[k].f_x, nodes[k].f_ix};
      std::copy(of, of + 4, rows.data + 4 * k);
    }
    nb::dict d;
    d["rows"] = surface.rows;
    d["columns"] = surface.columns;
    d["last_row"] = surface.last_row;
    d["last_column"] = surface.last_column;
    d["x_min"] = surface.x_min;
    d["x_step"] = surface.x_step;
    d["per_metre"] = surface.per_metre;
    d["iu_min"] = surface.iu_min;
    d["iu_step"] = surface.iu_step;
    d["per_ampere"] = surface.per_ampere;
    d["ampere"] = surface.ampere;
    d["metre"] = surface.metre;
    d["nodes"] = rows.array;
    return d;
  }
};

struct Fuzzy : Magnet {
  std::vector<amb_real> centre_iu, centre_x, sharp_ki, sharp_ks, weight_ki, weight_ks;
  amb_fuzzy net{};
  Fuzzy(const Vector &c_iu, const Vector &c_x, const Vector &h_ki, const Vector &w_ki,
        const Vector &h_ks, const Vector &w_ks, amb_real per_ampere, amb_real per_metre,
        amb_real iu_min, amb_real iu_max, amb_real x_min, amb_real x_max, bool normalised)
      : centre_iu(copied(c_iu)), centre_x(copied(c_x)), sharp_ki(copied(h_ki)),
        sharp_ks(copied(h_ks)), weight_ki(copied(w_ki)), weight_ks(copied(w_ks))
  {
    const size_t n = c_iu.size();
    if (n < 1 || n > AMB_FUZZY_MAX_RULES)
      throw std::invalid_argument("a network has 1 to " + std::to_string(AMB_FUZZY_MAX_RULES) +
                                  " rules, got " + std::to_string(n));
    for (const Vector *a : {&c_x, &h_ki, &w_ki, &h_ks, &w_ks})
      same_length(n, a->size(), "a network's array");
    net.rules = static_cast<int>(n);
    net.normalised = normalised;
    net.per_ampere = per_ampere;
    net.per_metre = per_metre;
    net.iu_min = iu_min;
    net.iu_max = iu_max;
    net.x_min = x_min;
    net.x_max = x_max;
    net.centre_iu = centre_iu.data();
    net.centre_x = centre_x.data();
    net.k_i = {sharp_ki.data(), weight_ki.data()};
    net.k_s = {sharp_ks.data(), weight_ks.data()};
    magnet = {&amb_fuzzy_magnet, &net};
  }

  InC in_c() const override
  {
    return {"amb_fuzzy", "amb_fuzzy_magnet", "fuzzy", "the fuzzy expert"};
  }
  Named parameters() const override
  {
    const size_t n = centre_iu.size();
    nb::dict d, of_ki, of_ks;
    of_ki["sharpness"] = shown(sharp_ki, {n});
    of_ki["weight"] = shown(weight_ki, {n});
    of_ks["sharpness"] = shown(sharp_ks, {n});
    of_ks["weight"] = shown(weight_ks, {n});
    d["rules"] = net.rules;
    d["normalised"] = net.normalised;
    d["per_ampere"] = net.per_ampere;
    d["per_metre"] = net.per_metre;
    d["iu_min"] = net.iu_min;
    d["iu_max"] = net.iu_max;
    d["x_min"] = net.x_min;
    d["x_max"] = net.x_max;
    d["centre_iu"] = shown(centre_iu, {n});
    d["centre_x"] = shown(centre_x, {n});
    d["k_i"] = of_ki;
    d["k_s"] = of_ks;
    return d;
  }

  Out<amb_real> basis(bool of_k_s, const Vector &iu, const Vector &x) const
  {
    same_length(iu.size(), x.size(), "x");
    const size_t n = iu.size(), rules = centre_iu.size();
    Fresh<amb_real> u({n, rules});
    {
      nb::gil_scoped_release release;
      for (size_t k = 0; k < n; k++)
        amb_fuzzy_basis(&net, of_k_s ? &net.k_s : &net.k_i, iu.data()[k], x.data()[k],
                        u.data + k * rules);
    }
    return u.array;
  }
};

Out<amb_real> force(const Magnet &self, const Vector &iu, const Vector &x)
{
  same_length(iu.size(), x.size(), "x");
  Fresh<amb_real> f({iu.size()});
  {
    nb::gil_scoped_release release;
    for (size_t k = 0; k < iu.size(); k++)
      f.data[k] = self.magnet.methods->force(self.magnet.self, iu.data()[k], x.data()[k]);
  }
  return f.array;
}

using Form = amb_stiffness (*)(const void *, amb_real, amb_real);

nb::typed<nb::tuple, Out<amb_real>, Out<amb_real>> stiffness(const Magnet &self, Form form,
                                                             const Vector &iu, const Vector &x)
{
  same_length(iu.size(), x.size(), "x");
  Fresh<amb_real> k_i({iu.size()}), k_s({iu.size()});
  {
    nb::gil_scoped_release release;
    for (size_t k = 0; k < iu.size(); k++) {
      const amb_stiffness at = form(self.magnet.self, iu.data()[k], x.data()[k]);
      k_i.data[k] = at.k_i;
      k_s.data[k] = at.k_s;
    }
  }
  return nb::make_tuple(k_i.array, k_s.array);
}

} // namespace

void bind_magnets(nb::module_ &m)
{
  nb::class_<Magnet>(m, "Magnet", "Force and stiffnesses at (iu [A], x [m]); arrays (n,).")
      .def("force", &force, nb::arg("iu"), nb::arg("x"),
           "Force relative to the bias force [N], (n,).")
      .def(
          "through_origin",
          [](const Magnet &self, const Vector &iu, const Vector &x) {
            return stiffness(self, self.magnet.methods->through_origin, iu, x);
          },
          nb::arg("iu"), nb::arg("x"), "k_i [N/A], k_s [N/m] with F = k_i iu + k_s x.")
      .def(
          "tangent",
          [](const Magnet &self, const Vector &iu, const Vector &x) {
            return stiffness(self, self.magnet.methods->tangent, iu, x);
          },
          nb::arg("iu"), nb::arg("x"), "k_i = dF/diu [N/A], k_s = dF/dx [N/m].")
      .def_prop_ro("parameters", &Magnet::parameters, nb::rv_policy::move,
                   "What the C struct holds, by the names of its fields.")
      .def_prop_ro(
          "in_c",
          [](const Magnet &self) {
            const InC c = self.in_c();
            return nb::typed<nb::tuple, nb::str, nb::str, nb::str, nb::str>(
                nb::make_tuple(c.type, c.methods, c.source, c.about));
          },
          "How it is called in C: struct, methods, header and source, and what it is.");
  nb::class_<Constant, Magnet>(m, "Constant", "Constant stiffness (paper, eq. 14).")
      .def(nb::init<amb_real, amb_real>(), nb::arg("k_i"), nb::arg("k_s"));
  nb::class_<Law, Magnet>(m, "Law", "A force law (models/laws), by its name and fields.")
      .def(nb::init<const std::string &, const nb::kwargs &>(),
           nb::sig("def __init__(self, name: str, **fields: float) -> None"));
  nb::class_<Table, Magnet>(m, "Table", "Bilinear stiffness tables, rows of x.")
      .def(nb::init<amb_real, amb_real, amb_real, amb_real, const Matrix &, const Matrix &>(),
           nb::arg("x_min"), nb::arg("dx"), nb::arg("iu_min"), nb::arg("diu"), nb::arg("k_i"),
           nb::arg("k_s"));
  nb::class_<Surface, Magnet>(m, "Surface", "Bicubic force (ambkit/surface.h), rows of x.")
      .def(nb::init<amb_real, amb_real, amb_real, amb_real, const Matrix &, const Matrix &,
                    const Matrix &, const Matrix &, amb_real, amb_real>(),
           nb::arg("x_min"), nb::arg("dx"), nb::arg("iu_min"), nb::arg("diu"), nb::arg("f"),
           nb::arg("f_i"), nb::arg("f_x"), nb::arg("f_ix"), nb::arg("ampere"), nb::arg("metre"));
  nb::class_<Fuzzy, Magnet>(m, "Fuzzy", "Fuzzy basis function network (paper, eq. 32-33).")
      .def(nb::init<const Vector &, const Vector &, const Vector &, const Vector &, const Vector &,
                    const Vector &, amb_real, amb_real, amb_real, amb_real, amb_real, amb_real,
                    bool>(),
           nb::arg("centre_iu"), nb::arg("centre_x"), nb::arg("sharpness_k_i"),
           nb::arg("weight_k_i"), nb::arg("sharpness_k_s"), nb::arg("weight_k_s"),
           nb::arg("per_ampere"), nb::arg("per_metre"), nb::arg("iu_min"), nb::arg("iu_max"),
           nb::arg("x_min"), nb::arg("x_max"), nb::arg("normalised"))
      .def("basis", &Fuzzy::basis, nb::arg("of_k_s"), nb::arg("iu"), nb::arg("x"),
           "Fuzzy basis functions (n, rules), eq. 32: normalised ones sum to 1. Held to the box.");
  m.attr("MAX_RULES") = AMB_FUZZY_MAX_RULES;
  m.def(
      "exp_negative",
      [](const Vector &t) {
        Fresh<amb_real> e({t.size()});
        for (size_t k = 0; k < t.size(); k++)
          e.data[k] = amb_exp_negative(t.data()[k]);
        return e.array;
      },
      nb::arg("t"), "exp(-t) for t >= 0 as the core computes it, (n,).");
  m.def(
      "phi",
      [](const Vector &z) {
        Fresh<amb_real> phi({z.size(), 3});
        for (size_t k = 0; k < z.size(); k++) {
          phi.data[3 * k] = amb_phi1(z.data()[k]);
          phi.data[3 * k + 1] = amb_phi2(z.data()[k]);
          phi.data[3 * k + 2] = amb_phi3(z.data()[k]);
        }
        return phi.array;
      },
      nb::arg("z"),
      "phi_1, phi_2, phi_3 (n, 3) at z >= 0 as the core computes them, (n,): the sums over n of "
      "(-z)^n / (n+k)!.");
}
