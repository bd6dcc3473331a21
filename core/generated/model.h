/* Which model is built in; an export has a file of its own here. */
#ifndef AMBKIT_GENERATED_MODEL_H
#define AMBKIT_GENERATED_MODEL_H

#include "generated/axial.h"

#endif
