// The implementations of ambkit/magnet.h, each with the memory it works on.
#pragma once

#include "arrays.h"

extern "C" {
#include "ambkit/fuzzy.h"
#include "ambkit/saturating.h"
#include "ambkit/surface.h"
#include "ambkit/table.h"
}

struct Magnet {
  amb_magnet magnet{};
  virtual ~Magnet() = default;
  Magnet() = default;
  Magnet(const Magnet &) = delete;      // `magnet.self` points into the object
  virtual Named parameters() const = 0; // the fields of what `magnet.self` points to
};
