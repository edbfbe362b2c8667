/* The yardstick: Tereshkov (2015), Eqs. (1)-(3), (11), (12), written by hand for one case in plain C: double, level start,
   known heading, GNSS epochs on the IMU's grid, no lever arm, no gaps, no status. The same arithmetic as the kernel. */
#include <math.h>

static void rotate(double c[9], const double p[3]) {
    const double q = p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
    double a, b;
    if (q > 0.0625) {
        const double angle = sqrt(q), half = sin(0.5 * angle);
        a = sin(angle) / angle;
        b = 2.0 * half * half / q;
    } else {
        a = 1.0 - q * (1.0 / 6 - q * (1.0 / 120 - q * (1.0 / 5040 - q * (1.0 / 362880 - q / 39916800))));
        b = 0.5 - q * (1.0 / 24 - q * (1.0 / 720 - q * (1.0 / 40320 - q * (1.0 / 3628800 - q / 479001600))));
    }
    for (int r = 0; r < 9; r += 3) {
        const double x = c[r], y = c[r + 1], z = c[r + 2];
        const double ux = y * p[2] - z * p[1], uy = z * p[0] - x * p[2], uz = x * p[1] - y * p[0];
        c[r] = x + a * ux + b * (uy * p[2] - uz * p[1]);
        c[r + 1] = y + a * uy + b * (uz * p[0] - ux * p[2]);
        c[r + 2] = z + a * uz + b * (ux * p[1] - uy * p[0]);
    }
}

static void orthonormalize(double c[9]) {
    double d[9];
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            double s = 0.0;
            for (int k = 0; k < 3; ++k) {
                double m = 0.0;
                for (int l = 0; l < 3; ++l) m += c[3 * i + l] * c[3 * k + l];
                s += (i == k ? 1.5 - 0.5 * m : -0.5 * m) * c[3 * k + j];
            }
            d[3 * i + j] = s;
        }
    for (int i = 0; i < 9; ++i) c[i] = d[i];
}

/* n samples (time, gyro 3, accel 3), an epoch of velocity at every `every`-th; returns the biases. */
void hand_loop(const double* t, const double* gyro, const double* accel, const double* velocity, long n, long every,
               double out[6]) {
    const double g = 9.80665, tau = 4.0, tau_h = 4.0, tau_g = 40.0, omega_a = 0.78539816339744831;
    double bg[3] = {0, 0, 0}, ba[3] = {0, 0, 0}, wp[3] = {0, 0, 0}, dv[3] = {0, 0, 0}, turn = 0.0;
    const double* v_before = velocity;
    double psi = atan2(velocity[1], velocity[0]);
    double c[9] = {cos(psi), -sin(psi), 0, sin(psi), cos(psi), 0, 0, 0, 1}, c_epoch[9];
    double t_epoch = t[0];
    for (int i = 0; i < 9; ++i) c_epoch[i] = c[i];
    for (long k = 1; k < n; ++k) {
        const double dt = t[k] - t[k - 1];
        double th[3], f[3], u[3], p[3];
        for (int i = 0; i < 3; ++i) {
            th[i] = ((gyro[3 * k - 3 + i] + gyro[3 * k + i]) * 0.5 - bg[i]) * dt;
            f[i] = ((accel[3 * k - 3 + i] + accel[3 * k + i]) * 0.5 - ba[i]) * dt;
            u[i] = (c[i] * wp[0] + c[3 + i] * wp[1] + c[6 + i] * wp[2]) * dt;
        }
        p[0] = th[0] - u[0] + 0.5 * (th[1] * u[2] - th[2] * u[1]);
        p[1] = th[1] - u[1] + 0.5 * (th[2] * u[0] - th[0] * u[2]);
        p[2] = th[2] - u[2] + 0.5 * (th[0] * u[1] - th[1] * u[0]);
        const double hx = f[0] + 0.5 * (p[1] * f[2] - p[2] * f[1]), hy = f[1] + 0.5 * (p[2] * f[0] - p[0] * f[2]),
                     hz = f[2] + 0.5 * (p[0] * f[1] - p[1] * f[0]);
        dv[0] += c[0] * hx + c[1] * hy + c[2] * hz;
        dv[1] += c[3] * hx + c[4] * hy + c[5] * hz;
        dv[2] += c[6] * hx + c[7] * hy + c[8] * hz;
        turn += c[6] * th[0] + c[7] * th[1] + c[8] * th[2];
        rotate(c, p);
        if (k % 32 == 0) orthonormalize(c);
        if (k % every == 0) {
            const double* v = velocity + 3 * (k / every);
            const double T = t[k] - t_epoch, kk = 1.0 / (g * tau);
            const double dn = (v[0] - v_before[0] - dv[0]) / T, de = (v[1] - v_before[1] - dv[1]) / T;
            double inn = atan2(v[1], v[0]) - atan2(c[3], c[0]);
            if (inn > M_PI) inn -= 2 * M_PI;
            if (inn <= -M_PI) inn += 2 * M_PI;
            wp[0] = -kk * de;
            wp[1] = kk * dn;
            wp[2] = -inn / tau_h;
            for (int i = 0; i < 3; ++i) {
                const double level = 0.5 * ((c_epoch[i] + c[i]) * wp[0] + (c_epoch[3 + i] + c[3 + i]) * wp[1]);
                const double up = 0.5 * (c_epoch[6 + i] + c[6 + i]) * wp[2];
                bg[i] += (level + up) * T / tau_g;
                ba[i] += g * (turn / T) * level * T / omega_a;
            }
            for (int i = 0; i < 9; ++i) c_epoch[i] = c[i];
            dv[0] = dv[1] = dv[2] = turn = 0.0;
            v_before = v;
            t_epoch = t[k];
        }
    }
    for (int i = 0; i < 3; ++i) out[i] = bg[i], out[3 + i] = ba[i];
}
