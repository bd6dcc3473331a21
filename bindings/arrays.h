// Arrays in, arrays out: NumPy in Python, plain pointers in C.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <initializer_list>
#include <list>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

extern "C" {
#include "ambkit/real.h"
}

namespace nb = nanobind;

using Vector = nb::ndarray<const amb_real, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Matrix = nb::ndarray<const amb_real, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Places = nb::ndarray<const unsigned short, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Named = nb::typed<nb::dict, nb::str, nb::any>; // returned values, by name
template <typename T> using Out = nb::ndarray<nb::numpy, T>;

// A new NumPy array that owns its memory, and the pointer to fill it through.
template <typename T> struct Fresh {
  T *data;
  Out<T> array;
  explicit Fresh(std::initializer_list<size_t> shape)
  {
    size_t size = 1;
    for (size_t extent : shape)
      size *= extent;
    data = new T[size > 0 ? size : 1]; // not initialised: every element is written
    nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    array = Out<T>(data, shape, owner);
  }
};

// Results of a function: new arrays by name.
class Results
{
public:
  template <typename T> T *add(const char *name, std::initializer_list<size_t> shape)
  {
    const Fresh<T> fresh(shape);
    by_name[name] = fresh.array;
    return fresh.data;
  }
  Named named() const
  {
    return by_name;
  }

private:
  nb::dict by_name;
};

// Read a number of a dict into the field with its name.
template <typename T> void read(const nb::dict &from, const char *name, T &to)
{
  to = nb::cast<T>(from[name]);
}

inline void same_length(size_t n, size_t other, const char *name)
{
  if (other != n)
    throw std::invalid_argument(std::string(name) + " has " + std::to_string(other) +
                                " samples, expected " + std::to_string(n));
}

// Arrays for the pointers of a struct of the core, copied from Python.
class Kept
{
public:
  const amb_real *keep(nb::handle values, size_t count, const char *name)
  {
    reals.push_back(nb::cast<std::vector<amb_real>>(values));
    same_length(count, reals.back().size(), name);
    return reals.back().data();
  }
  const amb_real *numbers(const nb::dict &fields, const char *name, size_t count)
  {
    return keep(fields[name], count, name);
  }
  const amb_real *or_none(const nb::dict &fields, const char *name, size_t count)
  {
    return fields[name].is_none() ? nullptr : numbers(fields, name, count);
  }

private:
  std::list<std::vector<amb_real>> reals; // a list, because its elements never move
};

inline std::vector<amb_real> copied(const Vector &a)
{
  return std::vector<amb_real>(a.data(), a.data() + a.size());
}

// Memory of the C core with its size: the part of an object that a copy must include.
template <typename T> using Parts = std::initializer_list<std::pair<T *, size_t>>;

inline nb::bytes kept(Parts<const void> parts)
{
  std::string all;
  for (const auto &[data, size] : parts)
    all.append(static_cast<const char *>(data), size);
  return nb::bytes(all.data(), all.size());
}

inline void restore(const nb::bytes &from, Parts<void> parts)
{
  size_t expected = 0;
  for (const auto &part : parts)
    expected += part.second;
  if (from.size() != expected)
    throw std::invalid_argument("a state has " + std::to_string(from.size()) + " bytes, expected " +
                                std::to_string(expected));
  const char *next = from.c_str();
  for (const auto &[data, size] : parts) {
    std::copy_n(next, size, static_cast<char *>(data));
    next += size;
  }
}

// A new NumPy array with the values at a struct's pointer.
inline Out<amb_real> shown(const std::vector<amb_real> &a, std::initializer_list<size_t> shape)
{
  Fresh<amb_real> copy(shape);
  std::copy(a.begin(), a.end(), copy.data);
  return copy.array;
}

void bind_magnets(nb::module_ &m);
void bind_model(nb::module_ &m);
void bind_sampling(nb::module_ &m);
void bind_settings(nb::module_ &m);
void bind_estimator(nb::module_ &m);
void bind_estimators(nb::module_ &m);
void bind_own(nb::module_ &m);
void bind_scale_estimators(nb::module_ &m);
void bind_learners(nb::module_ &m);
void bind_rls(nb::module_ &m);
void bind_isolation(nb::module_ &m);
void bind_angle(nb::module_ &m);
void bind_control(nb::module_ &m);
void bind_loop(nb::module_ &m);
void bind_batch(nb::module_ &m);
void bind_many(nb::module_ &m);
