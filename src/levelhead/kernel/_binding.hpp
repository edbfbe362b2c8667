// What every class of the binding shares: shapes are checked, the GIL is released, the header is called. No mathematics here.
#ifndef LEVELHEAD_BINDING_HPP
#define LEVELHEAD_BINDING_HPP

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <stdint.h>
#include <string.h>

#include <type_traits>

#include "_epochs.hpp"
#include "levelhead/levelhead.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using namespace levelhead;

namespace binding {

using Vector = nb::ndarray<const double, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Rows = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using RowsOut = nb::ndarray<double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using StatusOut = nb::ndarray<uint32_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;

// Three numbers from a tuple, a list, a float64 array, or any other sequence: the streaming path, so the common kinds first.
inline void read3(nb::handle object, const char* name, double out[3]) {
    PyObject* o = object.ptr();
    if (PyTuple_CheckExact(o) || PyList_CheckExact(o)) {
        if (Py_SIZE(o) == 3) {
            for (int i = 0; i < 3; ++i) {
                // A strong reference: converting a number may run Python code, which may change the list.
                nb::object item = nb::steal(PySequence_GetItem(o, i));
                if (!item.is_valid()) throw nb::python_error();
                out[i] = PyFloat_AsDouble(item.ptr());
                if (out[i] == -1.0 && PyErr_Occurred()) throw nb::python_error();
            }
            return;
        }
    } else if (PyObject_CheckBuffer(o)) {
        Py_buffer view;
        if (PyObject_GetBuffer(o, &view, PyBUF_FORMAT | PyBUF_C_CONTIGUOUS) == 0) {
            const bool fits = view.ndim == 1 && view.shape == nullptr ? view.len == 24 : view.ndim == 1 && view.len == 24;
            const bool doubles = fits && view.format != nullptr && strcmp(view.format, "d") == 0;
            if (doubles) memcpy(out, view.buf, 24);
            PyBuffer_Release(&view);
            if (doubles) return;
        } else {
            PyErr_Clear();  // not contiguous: the sequence protocol below reads it
        }
    }
    if (!PySequence_Check(o) || PySequence_Size(o) != 3) {
        PyErr_Clear();
        PyErr_Format(PyExc_ValueError, "%s needs three numbers (x, y, z).", name);
        throw nb::python_error();
    }
    for (int i = 0; i < 3; ++i) {
        nb::object item = nb::steal(PySequence_GetItem(o, i));
        if (!item.is_valid()) throw nb::python_error();
        out[i] = PyFloat_AsDouble(item.ptr());
        if (out[i] == -1.0 && PyErr_Occurred()) throw nb::python_error();
    }
}

template <class S>
Vec3<S> vec3(nb::handle object, const char* name) {
    double v[3];
    read3(object, name, v);
    return {S(v[0]), S(v[1]), S(v[2])};
}

template <class S>
Vec3<S> row(const double* p) {
    return {S(p[0]), S(p[1]), S(p[2])};
}

// Three sigmas from None, a number, or three numbers; NaN where unknown.
template <class S>
Vec3<S> std3(nb::handle object) {
    if (object.is_none()) return {S(NAN), S(NAN), S(NAN)};
    if (PyNumber_Check(object.ptr()) && (!PySequence_Check(object.ptr()) || PySequence_Size(object.ptr()) < 0)) {
        PyErr_Clear();  // an array of no dimensions has no length but is a number
        const double value = PyFloat_AsDouble(object.ptr());
        if (value == -1.0 && PyErr_Occurred()) throw nb::python_error();
        return {S(value), S(value), S(value)};
    }
    return vec3<S>(object, "velocity_std");
}

template <class S>
nb::object array3(const Vec3<S>& v) {
    const double values[3] = {double(v.x), double(v.y), double(v.z)};
    return nb::cast(nb::ndarray<nb::numpy, const double, nb::shape<3>>(values), nb::rv_policy::copy);
}

// ---- save and restore: a header that says what the bytes are, then the stream's plain data, then a checksum ----

struct BlobHeader {
    char magic[4];
    uint32_t format, estimator, scalar_bytes, payload_bytes, byte_order;
};

constexpr uint32_t blob_format = 3;

inline uint64_t checksum(const unsigned char* bytes, size_t count) {
    uint64_t h = 1469598103934665603ull;  // FNV-1a
    for (size_t i = 0; i < count; ++i) h = (h ^ bytes[i]) * 1099511628211ull;
    return h;
}

template <class Stream>
BlobHeader blob_header(uint32_t estimator) {
    return {{'L', 'V', 'H', 'D'}, blob_format, estimator, sizeof(typename Stream::S), sizeof(Stream), 0x01020304u};
}

template <class Stream>
nb::bytes save(const Stream& s, uint32_t estimator) {
    constexpr size_t size = sizeof(BlobHeader) + sizeof(Stream);
    unsigned char bytes[size + 8];
    const BlobHeader header = blob_header<Stream>(estimator);
    memcpy(bytes, &header, sizeof header);
    memcpy(bytes + sizeof header, &s, sizeof s);
    const uint64_t sum = checksum(bytes, size);
    memcpy(bytes + size, &sum, 8);
    return nb::bytes(reinterpret_cast<const char*>(bytes), sizeof bytes);
}

template <class Stream>
void restore(Stream& s, const nb::bytes& blob, uint32_t estimator) {
    constexpr size_t size = sizeof(BlobHeader) + sizeof(Stream);
    const BlobHeader wanted = blob_header<Stream>(estimator);
    const auto* bytes = reinterpret_cast<const unsigned char*>(blob.c_str());
    uint64_t sum = 0;
    const bool long_enough = blob.size() == size + 8;
    if (long_enough) memcpy(&sum, bytes + size, 8);
    if (blob.size() < sizeof wanted || memcmp(bytes, &wanted, sizeof wanted) != 0)
        throw nb::value_error("The blob is not a state saved by this estimator in this version of levelhead; save it anew.");
    if (!long_enough || sum != checksum(bytes, size))
        throw nb::value_error("The saved state is damaged (its checksum does not fit); use an earlier one.");
    memcpy(&s, bytes + sizeof wanted, sizeof s);
}

// ---- one class per estimator and scalar ----

const char* const event_names[EVENT_COUNT] = {"W_GAP", "E_GAP_RESET", "S_COAST", "S_REVERSE", "W_TIME_BACK", "E_NONFINITE",
                                              "S_STATIONARY", "W_POSITION_JUMP"};

template <class Stream>
nb::list events(const Stream& s) {
    nb::list out;
    for (uint32_t i = 0; i < EVENT_COUNT; ++i)
        if (s.events[i].count > 0) out.append(nb::make_tuple(event_names[i], s.events[i].count, s.events[i].first, s.events[i].last));
    return out;
}

// The body axis nearest to the vertical: level driving teaches nothing about its accelerometer bias.
template <class Stream>
int vertical_axis(const Stream& s) {
    const auto& down = s.estimator.platform.dcm_body_to_ned.z;
    const double x = fabs(double(down.x)), y = fabs(double(down.y)), z = fabs(double(down.z));
    return z >= x && z >= y ? 2 : (y >= x ? 1 : 0);
}

template <class Stream>
Vec3<double> shown_accel_bias(const Stream& s) {
    const auto& b = s.estimator.accel_bias;
    if constexpr (std::remove_reference_t<decltype(s.estimator)>::vertical_accel_bias) return {double(b.x), double(b.y), double(b.z)};
    const int hidden = vertical_axis(s);
    return {hidden == 0 ? NAN : double(b.x), hidden == 1 ? NAN : double(b.y), hidden == 2 ? NAN : double(b.z)};
}

// What is shown of the attitude: NaN until it is known.
struct Attitude {
    double roll, pitch, heading;
};

template <class Stream>
Attitude attitude(const Stream& s) {
    const auto& p = s.estimator.platform;
    Attitude a{NAN, NAN, NAN};
    if (p.aligned > 0.5f) {
        a.roll = double(roll(p.dcm_body_to_ned));
        a.pitch = double(pitch(p.dcm_body_to_ned));
        if (p.heading_known > 0.5f) a.heading = double(heading(p.dcm_body_to_ned));
    }
    return a;
}

template <class Stream>
Vec3<double> shown_velocity(const Stream& s) {
    if (!(s.estimator.platform.aligned > 0.5f)) return {NAN, NAN, NAN};
    const auto v = s.velocity_ned();
    return {double(v.x), double(v.y), double(v.z)};
}

// What the estimator knows of its position; NaN where it does not estimate one.
template <class Stream>
Geodetic shown_position(const Stream& s) {
    if constexpr (std::remove_reference_t<decltype(s.estimator)>::takes_positions) return s.estimator.position();
    return {NAN, NAN, NAN};
}

// The readings of one run, rows in the order of time: IMU time, gyro, accel, wheel speed (NaN or no rows: none); GNSS time,
// velocity and its sigma, position (rad, rad, m) and its sigma, NaN where absent.
struct Inputs {
    Vector time;
    Rows gyro, accel;
    Vector wheel, gnss_time;
    Rows velocity, velocity_std, position, position_std;

    Inputs(const nb::tuple& imu, const nb::tuple& gnss)
        : time(nb::cast<Vector>(imu[0])), gyro(nb::cast<Rows>(imu[1])), accel(nb::cast<Rows>(imu[2])), wheel(nb::cast<Vector>(imu[3])),
          gnss_time(nb::cast<Vector>(gnss[0])), velocity(nb::cast<Rows>(gnss[1])), velocity_std(nb::cast<Rows>(gnss[2])),
          position(nb::cast<Rows>(gnss[3])), position_std(nb::cast<Rows>(gnss[4])) {
        const size_t n = time.shape(0), m = gnss_time.shape(0);
        bool fits = gyro.shape(0) == n && accel.shape(0) == n && (wheel.shape(0) == n || wheel.shape(0) == 0);
        for (const Rows* rows : {&velocity, &velocity_std, &position, &position_std}) fits = fits && rows->shape(0) == m;
        if (!fits) throw nb::value_error("The arrays of one run differ in length.");
    }
};

// Arrays to fill, one row per IMU sample; those from the sigmas on may have no rows: then they are not asked for.
struct Outputs {
    double *gyro_bias, *accel_bias, *attitude, *velocity;
    uint32_t* status;
    double *gyro_bias_std, *accel_bias_std, *attitude_std, *velocity_std, *position, *position_std;

    Outputs(const nb::tuple& arrays, size_t n) {
        const auto rows = [&](int i, bool optional) -> double* {
            const RowsOut array = nb::cast<RowsOut>(arrays[i]);
            if (array.shape(0) != n && !(optional && array.shape(0) == 0)) throw nb::value_error("The arrays of one run differ in length.");
            return array.shape(0) == 0 ? nullptr : array.data();
        };
        gyro_bias = rows(0, false);
        accel_bias = rows(1, false);
        attitude = rows(2, false);
        velocity = rows(3, false);
        const StatusOut flags = nb::cast<StatusOut>(arrays[4]);
        if (flags.shape(0) != n) throw nb::value_error("The arrays of one run differ in length.");
        status = flags.data();
        gyro_bias_std = rows(5, true);
        accel_bias_std = rows(6, true);
        attitude_std = rows(7, true);
        velocity_std = rows(8, true);
        position = rows(9, true);
        position_std = rows(10, true);
    }
};

template <class S>
void put(double* out, size_t i, const Vec3<S>& v) {
    out[3 * i] = double(v.x);
    out[3 * i + 1] = double(v.y);
    out[3 * i + 2] = double(v.z);
}

inline void put(double* out, size_t i, const Geodetic& p) { put(out, i, Vec3<double>{p.latitude, p.longitude, p.height}); }

// The sigmas that are asked for.
template <class S>
void put(const Outputs& out, size_t i, const Sigma<S>& sigma) {
    put(out.gyro_bias_std, i, sigma.gyro_bias);
    put(out.accel_bias_std, i, sigma.accel_bias);
    put(out.attitude_std, i, sigma.attitude);
    if (out.velocity_std) put(out.velocity_std, i, sigma.velocity);
    if (out.position_std) put(out.position_std, i, sigma.position);
}

template <class Stream>
void show(const Stream& s, const Outputs& out, size_t i) {
    const Attitude a = attitude(s);
    put(out.gyro_bias, i, s.estimator.gyro_bias);
    put(out.accel_bias, i, s.estimator.accel_bias);
    put(out.attitude, i, Vec3<double>{a.roll, a.pitch, a.heading});
    put(out.velocity, i, shown_velocity(s));
    out.status[i] = s.status();
    if (out.position) put(out.position, i, shown_position(s));
    if (out.gyro_bias_std) put(out, i, s.estimator.sigma());
}

// Feed samples and epochs in time order, an epoch after the sample of the same stamp. Returns the epochs used up. `watch`
// is called after whatever may have closed an interval, `tell` after each sample with its epochs.
template <class Stream, class Watch, class Tell>
size_t run_watched(Stream& s, const Inputs& in, const Outputs& out, Watch watch, Tell tell) {
    using S = typename Stream::S;
    const size_t n = in.time.shape(0), m = in.gnss_time.shape(0);
    const double *t = in.time.data(), *w = in.gyro.data(), *f = in.accel.data(), *tg = in.gnss_time.data(), *v = in.velocity.data(),
                 *sd = in.velocity_std.data(), *p = in.position.data(), *psd = in.position_std.data(),
                 *wheel = in.wheel.shape(0) > 0 ? in.wheel.data() : nullptr;
    nb::gil_scoped_release unlocked;
    const auto epoch = [&](size_t j) {
        s.gnss(tg[j], row<S>(v + 3 * j), row<S>(sd + 3 * j), Geodetic{p[3 * j], p[3 * j + 1], p[3 * j + 2]}, row<S>(psd + 3 * j));
    };
    size_t j = 0;
    for (size_t i = 0; i < n; ++i) {
        while (j < m && tg[j] < t[i]) epoch(j++);
        s.imu(t[i], row<S>(w + 3 * i), row<S>(f + 3 * i));
        if (wheel && wheel[i] == wheel[i]) s.wheel(S(wheel[i]));
        watch();
        while (j < m && tg[j] == t[i]) {
            epoch(j++);
            watch();
        }
        tell(out, i);
    }
    return j;
}

template <class Stream>
size_t run(Stream& s, const nb::tuple& imu, const nb::tuple& gnss, const nb::tuple& arrays) {
    const Inputs in(imu, gnss);
    const Outputs out(arrays, in.time.shape(0));
    return run_watched(s, in, out, [] {}, [&s](const Outputs& o, size_t i) { show(s, o, i); });
}

template <class S>
PlatformParams<S> platform_params(double tau, double tau_heading, double min_course_speed, double gravity, nb::handle lever_arm,
                                  nb::handle latitude = nb::none()) {
    const bool known = !latitude.is_none();
    return {S(tau), S(tau_heading), S(min_course_speed), S(gravity), vec3<S>(lever_arm, "lever_arm"), known ? 1u : 0u,
            known ? S(nb::cast<double>(latitude)) : S(0)};
}

template <class Estimator>
nb::class_<Stream<Estimator>> bind_stream(nb::module_& m, const char* name, uint32_t id) {
    using St = Stream<Estimator>;
    using S = typename Estimator::Scalar;
    nb::class_<St> c(m, name);
    c.def("__init__", [id](St* self, const nb::bytes& blob) {
        St s{};
        restore(s, blob, id);
        new (self) St(s);
    }, "blob"_a);
    c.def("update_imu", [](St& s, double t, nb::handle gyro, nb::handle accel) {
        return s.imu(t, vec3<S>(gyro, "gyro"), vec3<S>(accel, "accel"));
    }, "t"_a, "gyro"_a, "accel"_a,
        "Take one IMU sample: stamp (s), angular rate (rad/s) and specific force (m/s^2), body FRD.\n\n"
        "Returns False where the sample was dropped: its stamp does not advance, or it is not finite.");
    if constexpr (Estimator::takes_positions) {
        c.def("update_gnss", [](St& s, double t, nb::handle velocity, nb::handle std, nb::handle position, nb::handle position_std) {
            const S unknown = S(NAN);
            const Vec3<S> v = velocity.is_none() ? Vec3<S>{unknown, unknown, unknown} : vec3<S>(velocity, "velocity_ned");
            double llh[3] = {NAN, NAN, NAN};
            if (!position.is_none()) read3(position, "position_llh", llh);
            if (fabs(llh[0]) > 0.5 * pi) throw nb::value_error("The latitude is beyond a pole; position_llh is (rad, rad, m).");
            return s.gnss(t, v, std3<S>(std), Geodetic{llh[0], llh[1], llh[2]}, std3<S>(position_std));
        }, "t"_a, "velocity_ned"_a = nb::none(), "velocity_std"_a = nb::none(), "position_llh"_a = nb::none(), "position_std"_a = nb::none(),
            "Take one GNSS epoch: stamp on the IMU's clock (s), velocity (m/s, NED) or None, its sigma (m/s: one number, three, or\n"
            "None), position (latitude rad, longitude rad, height m, WGS-84) or None, its sigma (m, likewise).\n\n"
            "The epoch may lie ahead of the last IMU sample, never behind it. Returns False where it was dropped.");
        c.def_prop_ro("position_llh", [](const St& s) {
            const Geodetic p = shown_position(s);
            return array3(Vec3<double>{p.latitude, p.longitude, p.height});
        }, "Position of the IMU (3,): latitude, longitude (rad), height (m), WGS-84; NaN until a fix has told one.");
        c.def_prop_ro("position_std", [](const St& s) { return array3(s.estimator.sigma().position); },
            "One sigma of the position (3,), North, East, Down, m; NaN where it is unknown.");
        c.def_prop_ro("velocity_std", [](const St& s) { return array3(s.estimator.sigma().velocity); },
            "One sigma of the velocity (3,), North, East, Down, m/s.");
    } else {
        c.def("update_gnss", [](St& s, double t, nb::handle velocity, nb::handle std) {
            return s.gnss(t, vec3<S>(velocity, "velocity_ned"), std3<S>(std));
        }, "t"_a, "velocity_ned"_a, "velocity_std"_a = nb::none(),
            "Take one GNSS epoch: stamp on the IMU's clock (s), velocity (m/s, NED), its sigma (m/s: one number, three, or None).\n\n"
            "The epoch may lie ahead of the last IMU sample, never behind it. Returns False where it was dropped.");
    }
    if constexpr (Estimator::takes_wheels)
        c.def("update_wheel", [](St& s, double speed) { return s.wheel(S(speed)); }, "speed"_a,
            "Take the speed that the wheels tell at the last IMU sample, m/s, negative in reverse. Returns False where it is not finite.");
    c.def("run", &run<St>);
    c.def("save", [id](const St& s) { return save(s, id); },
        "Return the whole state as bytes; `restore` continues from it bit for bit.");
    c.def_prop_ro("time", [](const St& s) { return s.started() ? s.time : NAN; }, "Stamp of the last IMU sample, s; NaN before it.");
    c.def_prop_ro("gyro_bias", [](const St& s) { return array3(s.estimator.gyro_bias); }, "Gyro bias (3,), rad/s, body frame.");
    c.def_prop_ro("accel_bias", [](const St& s) { return array3(shown_accel_bias(s)); },
        "Accelerometer bias (3,), m/s^2, body frame; NaN for the axis nearest to the vertical.");
    c.def_prop_ro("roll", [](const St& s) { return attitude(s).roll; }, "Roll, rad; NaN until it is known.");
    c.def_prop_ro("pitch", [](const St& s) { return attitude(s).pitch; }, "Pitch, rad; NaN until it is known.");
    c.def_prop_ro("heading", [](const St& s) { return attitude(s).heading; }, "Heading, rad; NaN before the first course.");
    c.def_prop_ro("velocity_ned", [](const St& s) { return array3(shown_velocity(s)); },
        "Velocity (3,), m/s: the last epoch's plus what the accelerometers have added since; NaN before start-up.");
    c.def_prop_ro("raw_status", [](const St& s) { return s.status(); });
    c.def_prop_ro("raw_events", [](const St& s) { return events(s); });
    c.def_prop_ro("vertical_axis", &vertical_axis<St>, "Index of the body axis nearest to the vertical.");
    c.def_prop_ro("dcm_body_to_ned", [](const St& s) {
        const auto& c = s.estimator.platform.dcm_body_to_ned;
        const double values[9] = {double(c.x.x), double(c.x.y), double(c.x.z), double(c.y.x), double(c.y.y),
                                  double(c.y.z), double(c.z.x), double(c.z.y), double(c.z.z)};
        return nb::cast(nb::ndarray<nb::numpy, const double, nb::shape<3, 3>>(values), nb::rv_policy::copy);
    }, "Attitude (3, 3): the platform's body-to-NED matrix.");
    c.def_prop_ro("sigma", [](const St& s) {
        const auto sigma = s.estimator.sigma();
        return nb::make_tuple(array3(sigma.gyro_bias), array3(sigma.accel_bias), array3(sigma.attitude));
    }, "One sigma (3,) of the gyro bias (rad/s), the accelerometer bias (m/s^2), and roll, pitch, heading (rad); NaN: unknown.");
    return c;
}

// The same, keeping what the uncertainty needs of every closed interval; an array of as many rows as could be closed.
template <class Stream>
size_t run_recorded(Stream& s, const nb::tuple& imu, const nb::tuple& gnss, const nb::tuple& arrays, EpochsOut epochs) {
    const Inputs in(imu, gnss);
    const Outputs shown(arrays, in.time.shape(0));
    if (epochs.shape(0) < in.gnss_time.shape(0) + 1)
        throw nb::value_error("The array of epochs needs one row more than there are epochs.");
    double* out = epochs.data();
    uint32_t closed = s.closed;
    run_watched(s, in, shown, [&] {
        if (s.closed == closed) return;
        closed = s.closed;
        put_epoch(out, s.gnss_time, s.interval);
        out += epoch_columns;
    }, [&s](const Outputs& o, size_t i) { show(s, o, i); });
    return size_t(out - epochs.data()) / epoch_columns;
}

// What the fixed-gain estimators show besides.
template <class Estimator>
void bind_residual(nb::class_<Stream<Estimator>>& c) {
    c.def_prop_ro("residual", [](const Stream<Estimator>& s) {
        const auto r = residual_squared(s.estimator.excitation);
        return nb::make_tuple(sqrt(double(r.gyro)), sqrt(double(r.accel)), sqrt(double(r.heading)));
    }, "Fraction of the initial (gyro, accel, heading) errors that can be left in the averaged loop.");
}

// ... and what their covariance is computed from.
template <class Estimator>
void bind_fixed_gain(nb::class_<Stream<Estimator>>& c) {
    bind_residual(c);
    c.def("run_recorded", &run_recorded<Stream<Estimator>>);
}

}  // namespace binding

#endif
