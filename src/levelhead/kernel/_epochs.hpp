// How one closed interval lies in a row of numbers between the two halves of the binding, and the half that reads them.
#ifndef LEVELHEAD_EPOCHS_HPP
#define LEVELHEAD_EPOCHS_HPP

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "levelhead/platform.hpp"

// The order is that of `Epochs` in estimators/uncertainty.py.
constexpr size_t epoch_columns = 16;
using EpochsOut = nanobind::ndarray<double, nanobind::shape<-1, epoch_columns>, nanobind::c_contig, nanobind::device::cpu>;

template <class S>
void put_epoch(double* row, double time, const levelhead::Interval<S>& i) {
    const double values[epoch_columns] = {
        time,           double(i.length),  double(i.turn),          double(i.learn),       double(i.level),
        double(i.aligned), double(i.heading_known), double(i.steered), double(i.speed), double(i.velocity_std),
        double(i.amiss.x), double(i.amiss.y), double(i.amiss.z), double(i.down_body.x), double(i.down_body.y), double(i.down_body.z)};
    for (size_t k = 0; k < epoch_columns; ++k) row[k] = values[k];
}

inline levelhead::Interval<double> get_epoch(const double* row) {
    levelhead::Interval<double> i{};
    i.length = row[1];
    i.turn = row[2];
    i.learn = row[3];
    i.level = row[4];
    i.aligned = row[5];
    i.heading_known = row[6];
    i.steered = row[7];
    i.speed = row[8];
    i.velocity_std = row[9];
    i.yaw_rate = i.turn / (i.length > 1e-6 ? i.length : 1e-6);
    return i;
}

#endif
