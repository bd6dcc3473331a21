// The force laws (models/laws). Written by `python -m models`; do not edit.
#pragma once

#include "magnets.h"
#include <cstddef>

extern "C" {
#include "ambkit/closed.h"
#include "ambkit/saturating.h"
}

static const LawInCore of_laws[] = {
    {"closed",
     {"amb_law", "amb_law_magnet", "closed", "the closed force law"},
     &amb_law_magnet,
     sizeof(amb_law),
     {{"k", offsetof(amb_law, k), false},
      {"s0", offsetof(amb_law, s0), false},
      {"i0", offsetof(amb_law, i0), false},
      {"two_sided", offsetof(amb_law, two_sided), true},
      {"ampere", offsetof(amb_law, ampere), false},
      {"metre", offsetof(amb_law, metre), false}}},
    {"saturating",
     {"amb_saturating_law", "amb_saturating_magnet", "saturating",
      "the force law of saturating iron"},
     &amb_saturating_magnet,
     sizeof(amb_saturating_law),
     {{"k", offsetof(amb_saturating_law, k), false},
      {"s0", offsetof(amb_saturating_law, s0), false},
      {"i0", offsetof(amb_saturating_law, i0), false},
      {"iron", offsetof(amb_saturating_law, iron), false},
      {"knee", offsetof(amb_saturating_law, knee), false},
      {"two_sided", offsetof(amb_saturating_law, two_sided), true},
      {"ampere", offsetof(amb_saturating_law, ampere), false},
      {"metre", offsetof(amb_saturating_law, metre), false}}},
};
