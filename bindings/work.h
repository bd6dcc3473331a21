// Work for several threads, and the instruction sets.
#pragma once

#include "arrays.h"

#include <nanobind/stl/string.h>

#include <atomic>
#include <thread>

extern "C" {
#include "batch.h"
}

inline const char *const INSTRUCTIONS[] = {"scalar", "baseline", "avx2", "avx512"};

// Those of this name; without a name the widest.
inline amb_instructions chosen(const std::optional<std::string> &name)
{
  amb_instructions best = AMB_BASELINE;
  for (int i = AMB_SCALAR; i <= AMB_AVX512; i++) {
    const auto set = static_cast<amb_instructions>(i);
    if (!amb_batch_has(set))
      continue;
    if (name && *name == INSTRUCTIONS[i])
      return set;
    best = set;
  }
  if (name)
    throw std::invalid_argument("this processor has no instructions called '" + *name + "'");
  return best;
}

// All pieces of work, `one(i)` each, by several threads and without Python's lock, which is
// acquired now and then to check for an interrupt. Returns false if there was one.
template <typename One> bool work_off(size_t pieces, size_t threads, const One &one)
{
  std::atomic<size_t> next{0};
  std::atomic<bool> stop{false};
  const auto another = [&] {
    const size_t i = next++;
    if (i >= pieces || stop)
      return false;
    one(i);
    return true;
  };
  std::vector<std::thread> helpers;
  for (size_t i = 1; i < std::min(threads, pieces); i++)
    helpers.emplace_back([&] {
      while (another()) {
      }
    });
  while (another()) {
    nb::gil_scoped_acquire acquire;
    if (PyErr_CheckSignals() != 0)
      stop = true;
  }
  for (std::thread &helper : helpers)
    helper.join();
  return !stop;
}
