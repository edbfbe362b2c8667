// Times the kernel against the hand-written C loop on one log in memory, the two in turn, and prints what each took.
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include <levelhead/levelhead.hpp>

extern "C" void hand_loop(const double*, const double*, const double*, const double*, long, long, double[6]);

using namespace levelhead;

static double now() {
    timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

template <class Estimator>
void kernel_loop(const typename Estimator::Params& k, const double* t, const double* gyro, const double* accel,
                 const double* velocity, long n, long every, double out[6]) {
    using S = typename Estimator::Scalar;
    const Vec3<S> none = {S(0), S(0), S(0)};
    Stream<Estimator> s = Stream<Estimator>::make(k, none, none);
    const auto row = [](const double* p) { return Vec3<S>{S(p[0]), S(p[1]), S(p[2])}; };
    for (long i = 0; i < n; ++i) {
        s.imu(t[i], row(gyro + 3 * i), row(accel + 3 * i));
        if (i % every == 0) s.gnss(t[i], row(velocity + 3 * (i / every)), S(NAN));
    }
    const auto& e = s.estimator;
    const S values[6] = {e.gyro_bias.x, e.gyro_bias.y, e.gyro_bias.z, e.accel_bias.x, e.accel_bias.y, e.accel_bias.z};
    for (int i = 0; i < 6; ++i) out[i] = double(values[i]);
}

template <class S>
PlatformParams<S> platform() {
    return {S(4), S(4), S(1), S(standard_gravity), {S(0), S(0), S(0)}};
}

// One loop: its name on the command line, and what runs it.
struct Loop {
    const char* name;
    void (*run)(const double* t, const double* gyro, const double* accel, const double* velocity, long n, long every, double out[6]);
};

template <class S>
PhasorParams<S> phasor() {
    const S degree = S(pi / 180);
    const PhasorNoise<S> noise = {S(0.5) * S(0.01) * degree * S(0.01) * degree, S(1e-4), S(4e-12), S(4e-8)};
    PhasorParams<S> k{platform<S>(), noise, S(0.03), S(0.5) * degree, S(0.5), S(0.5) * degree, S(0.3), S(0.8), S(0)};
    k.feel_earth = k.find_rest = true;  // as by default from Python
    return k;
}

template <class S>
EkfParams<S> ekf() {
    const S degree = S(pi / 180);
    return {platform<S>(), S(0.01) * degree, S(0.0142), S(2e-6), S(2e-4), S(0.03), S(0.5) * degree, S(0.3), S(0.8)};
}

const Loop loops[] = {
    {"hand-written C, double", hand_loop},
    {"observer, double", [](auto... log) { kernel_loop<Observer<double>>({platform<double>(), 40.0, pi / 4, 0}, log...); }},
    {"observer, float", [](auto... log) { kernel_loop<Observer<float>>({platform<float>(), 40.0f, float(pi / 4), 0}, log...); }},
    {"two-stage, double", [](auto... log) { kernel_loop<TwoStage<double>>({platform<double>(), 40.0, 40.0, 0.035, 0.14, 1}, log...); }},
    {"phasor, double", [](auto... log) { kernel_loop<Phasor<double>>(phasor<double>(), log...); }},
    {"phasor, float", [](auto... log) { kernel_loop<Phasor<float>>(phasor<float>(), log...); }},
    {"15-state EKF, double", [](auto... log) { kernel_loop<Ekf<double>>(ekf<double>(), log...); }},
};
constexpr int loop_count = int(sizeof loops / sizeof loops[0]);

// Usage: kernel_loop FILE SAMPLES EVERY ROUNDS [LOOP]; FILE holds time, gyro, accel, velocity as doubles. LOOP is the number
// of the only one to run, for a counter of instructions.
int main(int argc, char** argv) {
    if (argc < 5) return 2;
    const long n = atol(argv[2]), every = atol(argv[3]), rounds = atol(argv[4]), m = (n + every - 1) / every;
    const int first = argc > 5 ? atoi(argv[5]) : 0, last = argc > 5 ? first + 1 : loop_count;
    if (first < -1 || last > loop_count) return 2;
    double* data = static_cast<double*>(malloc(sizeof(double) * size_t(7 * n + 3 * m)));
    FILE* file = fopen(argv[1], "rb");
    if (!data || !file || fread(data, sizeof(double), size_t(7 * n + 3 * m), file) != size_t(7 * n + 3 * m)) return 3;
    fclose(file);
    const double *t = data, *gyro = t + n, *accel = gyro + 3 * n, *velocity = accel + 3 * n;
    double out[6], nanoseconds[loop_count] = {};
    for (int i = first < 0 ? last : first; i < last; ++i) {
        printf("name %s\n", loops[i].name);
    }
    for (long r = 0; r < rounds; ++r) {
        for (int i = first < 0 ? last : first; i < last; ++i) {
            const double begin = now();
            loops[i].run(t, gyro, accel, velocity, n, every, out);
            nanoseconds[i] = (now() - begin) / double(n) * 1e9;
            if (r == 0) printf("bias %.9f %.9f %.9f %.9f\n", out[0], out[1], out[3], out[4]);
        }
        printf("time");
        for (int i = first < 0 ? last : first; i < last; ++i) printf(" %.3f", nanoseconds[i]);
        printf("\n");
    }
    free(data);
    return 0;
}
