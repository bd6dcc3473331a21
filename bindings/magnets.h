// The implementations of ambkit/magnet.h, with their memory.
#pragma once

#include "arrays.h"

extern "C" {
#include "ambkit/fuzzy.h"
#include "ambkit/surface.h"
#include "ambkit/table.h"
}

// Names of a magnet of the core in C: its struct and methods, its header and source, and its kind.
struct InC {
  const char *type, *methods, *source, *about;
};

// A law of models/laws, and the offsets of the fields of its struct.
struct LawInCore {
  const char *name;
  InC in_c;
  const amb_magnet_methods *methods;
  size_t size;
  struct Field {
    const char *name;
    size_t offset;
    bool is_bool;
  };
  std::vector<Field> fields;
};

struct Magnet {
  amb_magnet magnet{};
  virtual ~Magnet() = default;
  Magnet() = default;
  Magnet(const Magnet &) = delete;      // `magnet.self` points into the object
  virtual Named parameters() const = 0; // the fields of the struct at `magnet.self`
  virtual InC in_c() const = 0;
};
