// The binding of the covariance recursion over recorded epochs. No mathematics here.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "_epochs.hpp"
#include "_modules.hpp"
#include "levelhead/levelhead.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using namespace levelhead;

namespace {

using Epochs = nb::ndarray<const double, nb::shape<-1, epoch_columns>, nb::c_contig, nb::device::cpu>;
using Pairs = nb::ndarray<const double, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;

// The order is that of `LevelSigma` in estimators/uncertainty.py.
constexpr size_t sigma_columns = 19;
using SigmaOut = nb::ndarray<double, nb::shape<-1, sigma_columns>, nb::c_contig, nb::device::cpu>;

template <bool Open, class Params>
void recur(const Params& k, const Noise<double>& noise, const Epochs& epochs, const Pairs& leak, SigmaOut out) {
    const double *e = epochs.data(), *l = leak.data();
    double* o = out.data();
    auto c = FixedGainCovariance<double, Open>::make(noise);
    for (size_t j = 0; j < epochs.shape(0); ++j, e += epoch_columns, o += sigma_columns) {
        const Interval<double> i = get_epoch(e);
        const double elapsed = j == 0 ? 0.0 : e[0] - e[-ptrdiff_t(epoch_columns)];
        c.epoch(k.platform, gains(k, i), noise, i, elapsed, {l[2 * j], l[2 * j + 1]});
        const LevelSigma<double> s = c.sigma();
        const double values[sigma_columns] = {s.tilt,        s.gyro,      s.accel,       s.heading, s.vertical_gyro, s.tilt_growth,
                                              s.tilt_rate, s.heading_growth, s.heading_rate, s.tilt_control, s.control, s.heading_control, s.steer, s.tilt_mean.re, s.tilt_mean.im, s.gyro_mean.re, s.gyro_mean.im, s.accel_mean.re, s.accel_mean.im};
        for (size_t n = 0; n < sigma_columns; ++n) o[n] = values[n];
    }
}

template <class Params>
void covariance(const Params& k, const Noise<double>& noise, const Epochs& epochs, const Pairs& leak, SigmaOut out, bool open) {
    if (leak.shape(0) != epochs.shape(0) || out.shape(0) != epochs.shape(0))
        throw nb::value_error("The arrays of one recursion differ in length.");
    nb::gil_scoped_release unlocked;
    if (open)
        recur<true>(k, noise, epochs, leak, out);
    else
        recur<false>(k, noise, epochs, leak, out);
}

}  // namespace

void bind_covariance(nb::module_& m) {
    using D = double;
    m.def(
        "observer_covariance",
        [](const Epochs& epochs, const Pairs& leak, SigmaOut out, D tau, D tau_heading, D gravity, D tau_gyro, D omega_accel,
           D gyro_noise, D accel_noise, D gyro_bias_walk, D accel_bias_walk, D velocity_std, D initial_gyro_bias_std,
           D initial_accel_bias_std) {
            const ObserverParams<D> k{{tau, tau_heading, 0.0, gravity, {0.0, 0.0, 0.0}, 0u, 0.0}, tau_gyro, omega_accel, 0u};
            covariance(k, {gyro_noise, accel_noise, gyro_bias_walk, accel_bias_walk, velocity_std, initial_gyro_bias_std,
                           initial_accel_bias_std}, epochs, leak, out, false);
        },
        "epochs"_a, "leak"_a, "out"_a, nb::kw_only(), "tau"_a, "tau_heading"_a, "gravity"_a, "tau_gyro"_a, "omega_accel"_a,
        "gyro_noise"_a, "accel_noise"_a, "gyro_bias_walk"_a, "accel_bias_walk"_a, "velocity_std"_a, "initial_gyro_bias_std"_a,
        "initial_accel_bias_std"_a);
    m.def(
        "two_stage_covariance",
        [](const Epochs& epochs, const Pairs& leak, SigmaOut out, D tau, D tau_heading, D gravity, D tau_gyro_lowpass,
           D tau_accel_lowpass, D straight_rate, D turn_rate, bool feedback, D gyro_noise, D accel_noise, D gyro_bias_walk,
           D accel_bias_walk, D velocity_std, D initial_gyro_bias_std, D initial_accel_bias_std) {
            const TwoStageParams<D> k{{tau, tau_heading, 0.0, gravity, {0.0, 0.0, 0.0}, 0u, 0.0}, tau_gyro_lowpass, tau_accel_lowpass,
                                      straight_rate, turn_rate, feedback ? 1u : 0u};
            covariance(k, {gyro_noise, accel_noise, gyro_bias_walk, accel_bias_walk, velocity_std, initial_gyro_bias_std,
                           initial_accel_bias_std}, epochs, leak, out, !feedback);
        },
        "epochs"_a, "leak"_a, "out"_a, nb::kw_only(), "tau"_a, "tau_heading"_a, "gravity"_a, "tau_gyro_lowpass"_a,
        "tau_accel_lowpass"_a, "straight_rate"_a, "turn_rate"_a, "feedback"_a, "gyro_noise"_a, "accel_noise"_a,
        "gyro_bias_walk"_a, "accel_bias_walk"_a, "velocity_std"_a, "initial_gyro_bias_std"_a, "initial_accel_bias_std"_a);
}
