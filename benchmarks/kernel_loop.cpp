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

// Usage: kernel_loop FILE SAMPLES EVERY ROUNDS; FILE holds time, gyro, accel, velocity as doubles.
int main(int argc, char** argv) {
    if (argc != 5) return 2;
    const long n = atol(argv[2]), every = atol(argv[3]), rounds = atol(argv[4]), m = (n + every - 1) / every;
    double* data = static_cast<double*>(malloc(sizeof(double) * size_t(7 * n + 3 * m)));
    FILE* file = fopen(argv[1], "rb");
    if (!file || fread(data, sizeof(double), size_t(7 * n + 3 * m), file) != size_t(7 * n + 3 * m)) return 3;
    fclose(file);
    const double *t = data, *gyro = t + n, *accel = gyro + 3 * n, *velocity = accel + 3 * n;
    const ObserverParams<double> od = {platform<double>(), 40.0, pi / 4, 0};
    const ObserverParams<float> of = {platform<float>(), 40.0f, float(pi / 4), 0};
    const TwoStageParams<double> td = {platform<double>(), 40.0, 40.0, 0.035, 0.14, 1};
    double out[4][6];
    for (long r = 0; r < rounds; ++r) {
        const double t0 = now();
        hand_loop(t, gyro, accel, velocity, n, every, out[0]);
        const double t1 = now();
        kernel_loop<Observer<double>>(od, t, gyro, accel, velocity, n, every, out[1]);
        const double t2 = now();
        kernel_loop<Observer<float>>(of, t, gyro, accel, velocity, n, every, out[2]);
        const double t3 = now();
        kernel_loop<TwoStage<double>>(td, t, gyro, accel, velocity, n, every, out[3]);
        const double t4 = now();
        printf("time %.3f %.3f %.3f %.3f\n", (t1 - t0) / double(n) * 1e9, (t2 - t1) / double(n) * 1e9,
               (t3 - t2) / double(n) * 1e9, (t4 - t3) / double(n) * 1e9);
    }
    for (int i = 0; i < 4; ++i)
        printf("bias %.9f %.9f %.9f %.9f\n", out[i][0], out[i][1], out[i][3], out[i][4]);
    free(data);
    return 0;
}
