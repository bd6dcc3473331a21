#include "instance.h"

amb_follow *const amb_exchange = NULL;
