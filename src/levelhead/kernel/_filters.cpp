// The binding of the filters: phasor, its smoother, and the baselines.
#include <vector>

#include "_binding.hpp"
#include "_modules.hpp"

using namespace binding;

namespace {

// None is an unknown number.
template <class S>
S number_or_nan(nb::handle value) { return value.is_none() ? S(NAN) : S(nb::cast<double>(value)); }

template <class S>
void bind_phasor(nb::module_& m, const char* name) {
    using St = Stream<Phasor<S>>;
    bind_stream<Phasor<S>>(m, name, 3)
        .def(
            "__init__",
            [](St* self, double min_course_speed, double gravity, nb::handle lever_arm, double gyro_noise, double accel_noise,
               double gyro_bias_walk, double accel_bias_walk, double velocity_std, double position_std, double timing_std,
               double sideslip_std, double axle_std, double wheel_std, nb::handle rear_axle, double initial_gyro_bias_std,
               double initial_accel_bias_std, nb::handle latitude, double gravity_std, bool earth_rotation, bool find_standstill,
               nb::handle gyro_bias, nb::handle accel_bias, nb::handle heading, double heading_std) {
                const PhasorNoise<S> noise = {S(gyro_noise), S(accel_noise), S(gyro_bias_walk), S(accel_bias_walk)};
                const Vec3<S> axle = rear_axle.is_none() ? Vec3<S>{S(0), S(0), S(0)} : vec3<S>(rear_axle, "rear_axle");
                const PhasorParams<S> k = {platform_params<S>(1.0, 1.0, min_course_speed, gravity, lever_arm), noise, S(velocity_std),
                                           S(sideslip_std), S(axle_std), S(initial_gyro_bias_std), S(initial_accel_bias_std),
                                           number_or_nan<S>(latitude), S(gravity_std), S(position_std), S(timing_std), S(wheel_std),
                                           axle, heading.is_none() ? S(0) : S(nb::cast<double>(heading)), heading.is_none() ? S(0) : S(heading_std), !rear_axle.is_none(), earth_rotation,
                                           find_standstill};
                new (self) St(St::make(k, vec3<S>(gyro_bias, "gyro_bias"), vec3<S>(accel_bias, "accel_bias")));
            },
            nb::kw_only(), "min_course_speed"_a, "gravity"_a, "lever_arm"_a, "gyro_noise"_a, "accel_noise"_a, "gyro_bias_walk"_a,
            "accel_bias_walk"_a, "velocity_std"_a, "position_std"_a, "timing_std"_a, "sideslip_std"_a, "axle_std"_a, "wheel_std"_a,
            "rear_axle"_a.none(), "initial_gyro_bias_std"_a, "initial_accel_bias_std"_a, "latitude"_a.none(), "gravity_std"_a,
            "earth_rotation"_a, "find_standstill"_a, "gyro_bias"_a, "accel_bias"_a, "heading"_a.none(), "heading_std"_a)
        .def_prop_ro("innovation_ratio", [](const St& s) { return sqrt(double(s.estimator.surprise)); },
                     "RMS of the innovations over their predicted sigma: 1 where the noise is as the parameters say.");
}

// The smoother keeps what the forward filter did at each epoch; there is no stream of it to save.
struct RecordSink {
    std::vector<SmootherRecord<double>> records;
    std::vector<Observation<double>> observations;
    std::vector<LiftObservation<double>> lifts;
    void push(const SmootherRecord<double>& r) { records.push_back(r); }
    void push(const Observation<double>& o) { observations.push_back(o); }
    void push(const LiftObservation<double>& o) { lifts.push_back(o); }
    long observed() const { return long(observations.size()); }
    long lifted() const { return long(lifts.size()); }
    Tape<double> tape() { return {records.data(), long(records.size()), observations.data(), lifts.data()}; }
};

struct Smoother {
    using Filter = Phasor<double, Recording<double, RecordSink>>;
    RecordSink sink;
    Stream<Filter> stream;

    Smoother(const PhasorParams<double>& k, const Vec3<double>& gyro_bias, const Vec3<double>& accel_bias)
        : stream(Stream<Filter>::make(k, gyro_bias, accel_bias)) {
        stream.estimator.recorder = {&sink, &stream.advanced_to, {}};
    }
    Smoother(const Smoother&) = delete;

    bool smoothed = false;
    void smooth_once() {
        if (!smoothed) smooth(sink.tape(), stream.estimator.gravity_var);
        smoothed = true;
    }
};

// Biases and heading at the first epoch and their sigmas, or None where nothing was ever aligned.
nb::object smoothed_start(Smoother& s) {
    if (s.sink.records.empty()) return nb::none();
    s.smooth_once();
    const SmootherRecord<double>& r = s.sink.records.front();
    const double facing = r.heading_known ? double(heading(r.dcm_body_to_ned)) : NAN;
    return nb::make_tuple(array3(r.gyro_bias), array3(r.accel_bias), array3(r.sigma.gyro_bias), array3(r.sigma.accel_bias), facing,
                          r.sigma.attitude.z);
}

void retrace(Smoother& s, const nb::tuple& imu, const nb::tuple& arrays) {
    const Vector time = nb::cast<Vector>(imu[0]);
    const Rows gyro = nb::cast<Rows>(imu[1]), accel = nb::cast<Rows>(imu[2]);
    const size_t n = time.shape(0);
    if (gyro.shape(0) != n || accel.shape(0) != n) throw nb::value_error("The arrays of one run differ in length.");
    const Outputs out(arrays, n);
    const Readings<double> readings = {time.data(), gyro.data(), accel.data(), long(n)};
    nb::gil_scoped_release unlocked;
    auto& records = s.sink.records;
    s.smooth_once();
    const Retracer<double> retracer = {records.data(), long(records.size()), readings};
    retracer.run([&](long index, const Retraced<double>& r) {
        const size_t i = size_t(index);
        const auto& c = r.dcm_body_to_ned;
        put(out.gyro_bias, i, r.gyro_bias);
        put(out.accel_bias, i, r.accel_bias);
        put(out.attitude, i, Vec3<double>{roll(c), pitch(c), r.heading_known ? heading(c) : NAN});
        put(out.velocity, i, r.velocity_ned);
        if (out.gyro_bias_std) put(out, i, r.sigma);
        if (out.position) put(out.position, i, r.place);
    });
}

void bind_smoother(nb::module_& m) {
    nb::class_<Smoother>(m, "SmootherF64")
        .def(
            "__init__",
            [](Smoother* self, const Stream<Phasor<double>>& forward) {
                new (self) Smoother(forward.params, forward.estimator.gyro_bias, forward.estimator.accel_bias);
            },
            "forward"_a)
        .def("run", [](Smoother& s, const nb::tuple& imu, const nb::tuple& gnss, const nb::tuple& arrays) {
            const Inputs in(imu, gnss);
            const Outputs out(arrays, in.time.shape(0));
            // What the filter knew on the way is not shown; where the way back does not come by, nothing is known.
            return run_watched(s.stream, in, out, [] {}, [&s](const Outputs& o, size_t i) {
                const Vec3<double> unknown = {NAN, NAN, NAN};
                put(o.gyro_bias, i, s.stream.estimator.gyro_bias);
                put(o.accel_bias, i, s.stream.estimator.accel_bias);
                o.status[i] = s.stream.status();
                for (double* rows : {o.attitude, o.velocity, o.gyro_bias_std, o.accel_bias_std, o.attitude_std, o.velocity_std, o.position,
                                     o.position_std})
                    if (rows) put(rows, i, unknown);
            });
        })
        .def("smoothed_start", &smoothed_start)
        .def("retrace", &retrace)
        .def_prop_ro("raw_events", [](const Smoother& s) { return events(s.stream); })
        .def_prop_ro("vertical_axis", [](const Smoother& s) { return vertical_axis(s.stream); })
        .def_prop_ro("innovation_ratio", [](const Smoother& s) { return sqrt(double(s.stream.estimator.surprise)); });
}

template <class S>
void bind_ekf(nb::module_& m, const char* name) {
    auto c = bind_stream<Ekf<S>>(m, name, 4);
    c.def(
        "__init__",
        [](Stream<Ekf<S>>* self, double min_course_speed, double gravity, nb::handle lever_arm, double gyro_noise, double accel_noise,
           double gyro_bias_walk, double accel_bias_walk, double velocity_std, double initial_gyro_bias_std,
           double initial_accel_bias_std, double latitude, double position_std, double timing_std, nb::handle gyro_bias,
           nb::handle accel_bias) {
            // The platform's time constants have no meaning for a Kalman filter.
            EkfParams<S> k{platform_params<S>(1.0, 1.0, min_course_speed, gravity, lever_arm), S(gyro_noise), S(accel_noise),
                           S(gyro_bias_walk), S(accel_bias_walk), S(velocity_std), S(initial_gyro_bias_std),
                           S(initial_accel_bias_std), S(latitude), S(position_std), S(timing_std)};
            new (self) Stream<Ekf<S>>(
                Stream<Ekf<S>>::make(k, vec3<S>(gyro_bias, "gyro_bias"), vec3<S>(accel_bias, "accel_bias")));
        },
        nb::kw_only(), "min_course_speed"_a, "gravity"_a, "lever_arm"_a, "gyro_noise"_a, "accel_noise"_a, "gyro_bias_walk"_a,
        "accel_bias_walk"_a, "velocity_std"_a, "initial_gyro_bias_std"_a, "initial_accel_bias_std"_a, "latitude"_a, "position_std"_a,
        "timing_std"_a, "gyro_bias"_a, "accel_bias"_a);
    c.def_prop_ro("covariance", [](const Stream<Ekf<S>>& s) {
        constexpr int n = ekf_states;
        double values[n * n];
        for (int i = 0; i < n * n; ++i) values[i] = double(s.estimator.covariance[i / n][i % n]);
        return nb::cast(nb::ndarray<nb::numpy, const double, nb::shape<n, n>>(values), nb::rv_policy::copy);
    }, "Covariance (15, 15) of the errors of position, velocity (NED), attitude (NED rotation vector), gyro and accel bias.");
}

template <class S>
void bind_mahony(nb::module_& m, const char* name) {
    auto c = bind_stream<Mahony<S>>(m, name, 5);
    bind_residual(c);
    c.def(
        "__init__",
        [](Stream<Mahony<S>>* self, double tau, double tau_heading, double min_course_speed, double gravity, nb::handle lever_arm,
           double tau_gyro, bool use_gnss_acceleration, nb::handle gyro_bias, nb::handle accel_bias) {
            MahonyParams<S> k{platform_params<S>(tau, tau_heading, min_course_speed, gravity, lever_arm), S(tau_gyro),
                              use_gnss_acceleration ? 1u : 0u};
            new (self) Stream<Mahony<S>>(
                Stream<Mahony<S>>::make(k, vec3<S>(gyro_bias, "gyro_bias"), vec3<S>(accel_bias, "accel_bias")));
        },
        nb::kw_only(), "tau"_a, "tau_heading"_a, "min_course_speed"_a, "gravity"_a, "lever_arm"_a, "tau_gyro"_a,
        "use_gnss_acceleration"_a, "gyro_bias"_a, "accel_bias"_a);
}

}  // namespace

void bind_filters(nb::module_& m) {
    bind_phasor<double>(m, "PhasorF64");
    bind_phasor<float>(m, "PhasorF32");
    bind_smoother(m);
    bind_ekf<double>(m, "EkfF64");
    bind_ekf<float>(m, "EkfF32");
    bind_mahony<double>(m, "MahonyF64");
    bind_mahony<float>(m, "MahonyF32");
}
