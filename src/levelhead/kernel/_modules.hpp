// The parts of the module, each in a file of its own.
#ifndef LEVELHEAD_MODULES_HPP
#define LEVELHEAD_MODULES_HPP

#include <nanobind/nanobind.h>

void bind_covariance(nanobind::module_& m);
void bind_filters(nanobind::module_& m);

#endif
