// The header on its own, as firmware uses it: no Python, no STL, no heap.
//   c++ -std=c++17 -I"$(python -c 'import levelhead; print(levelhead.get_include())')" examples/observer.cpp -o observer
#include <stdio.h>

#include <levelhead/levelhead.hpp>

using namespace levelhead;
using Observer32 = Stream<Observer<float>>;

int main() {
    const PlatformParams<float> platform = {4.0f, 4.0f, 1.0f, 9.80665f, {0.0f, 0.0f, 0.0f}};  // tau, tau_heading, speed, g, arm
    const ObserverParams<float> params = {platform, 40.0f, 0.785398f, 0};                     // tau_g, omega_a, general gain
    Observer32 observer = Observer32::make(params, {0, 0, 0}, {0, 0, 0});

    // A straight at 3 m/s with a gyro bias of 0.1 deg/s about x; a real driver puts its readings here.
    for (int k = 0; k < 60000; ++k) {
        const double t = 0.01 * k;
        observer.imu(t, {0.0017453f, 0.0f, 0.0f}, {0.0f, 0.0f, -9.80665f});
        if (k % 10 == 0) observer.gnss(t, {3.0f, 0.0f, 0.0f}, 0.03f);
    }
    const float degrees = 57.29578f;
    printf("gyro bias x %.4f deg/s, roll %.3f deg, status %u\n", double(observer.estimator.gyro_bias.x * degrees),
           double(roll(observer.estimator.platform.dcm_body_to_ned) * degrees), unsigned(observer.status()));
    return 0;
}
