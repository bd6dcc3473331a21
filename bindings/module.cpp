#include <nanobind/nanobind.h>
namespace nb = nanobind;
NB_MODULE(AMBKIT_MODULE_NAME, m) { m.attr("precision") = 8; }
