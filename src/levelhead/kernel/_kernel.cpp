// The binding of the papers' estimators, and the module.
#include "_binding.hpp"
#include "_modules.hpp"

using namespace binding;

namespace {

template <class S>
void bind_observer(nb::module_& m, const char* name) {
    auto c = bind_stream<Observer<S>>(m, name, 1);
    bind_fixed_gain(c);
    c.def(
        "__init__",
        [](Stream<Observer<S>>* self, double tau, double tau_heading, double min_course_speed, double gravity, nb::handle lever_arm,
           double tau_gyro, double omega_accel, bool paper_gain, nb::handle latitude, nb::handle gyro_bias, nb::handle accel_bias) {
            ObserverParams<S> k{platform_params<S>(tau, tau_heading, min_course_speed, gravity, lever_arm, latitude), S(tau_gyro),
                                S(omega_accel), paper_gain ? 1u : 0u};
            new (self) Stream<Observer<S>>(
                Stream<Observer<S>>::make(k, vec3<S>(gyro_bias, "gyro_bias"), vec3<S>(accel_bias, "accel_bias")));
        },
        nb::kw_only(), "tau"_a, "tau_heading"_a, "min_course_speed"_a, "gravity"_a, "lever_arm"_a, "tau_gyro"_a, "omega_accel"_a,
        "paper_gain"_a, "latitude"_a.none() = nb::none(), "gyro_bias"_a, "accel_bias"_a);
}

template <class S>
void bind_two_stage(nb::module_& m, const char* name) {
    auto c = bind_stream<TwoStage<S>>(m, name, 2);
    bind_fixed_gain(c);
    c.def(
        "__init__",
        [](Stream<TwoStage<S>>* self, double tau, double tau_heading, double min_course_speed, double gravity, nb::handle lever_arm,
           double tau_gyro_lowpass, double tau_accel_lowpass, double straight_rate, double turn_rate, bool feedback,
           nb::handle latitude, nb::handle gyro_bias, nb::handle accel_bias) {
            TwoStageParams<S> k{platform_params<S>(tau, tau_heading, min_course_speed, gravity, lever_arm, latitude), S(tau_gyro_lowpass),
                                S(tau_accel_lowpass), S(straight_rate), S(turn_rate), feedback ? 1u : 0u};
            new (self) Stream<TwoStage<S>>(
                Stream<TwoStage<S>>::make(k, vec3<S>(gyro_bias, "gyro_bias"), vec3<S>(accel_bias, "accel_bias")));
        },
        nb::kw_only(), "tau"_a, "tau_heading"_a, "min_course_speed"_a, "gravity"_a, "lever_arm"_a, "tau_gyro_lowpass"_a,
        "tau_accel_lowpass"_a, "straight_rate"_a, "turn_rate"_a, "feedback"_a, "latitude"_a.none() = nb::none(), "gyro_bias"_a, "accel_bias"_a);
}

}  // namespace

NB_MODULE(_kernel, m) {
    m.doc() = "The compiled kernel of levelhead; use the classes of the package instead.";
    bind_observer<double>(m, "ObserverF64");
    bind_observer<float>(m, "ObserverF32");
    bind_two_stage<double>(m, "TwoStageF64");
    bind_two_stage<float>(m, "TwoStageF32");
    bind_filters(m);
    bind_covariance(m);
    m.attr("DEFAULT_GRAVITY") = standard_gravity;
}
