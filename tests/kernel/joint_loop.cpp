// The linear algebra of the joint errors on its own, for test_joint.py: numbers in, numbers out.
//     in:  P upper triangle (n, t, g, a, p by rows: re im each), pair xx xb bb, noise of gyro, accel, accel walk, heading;
//          steps; per step: length, turn, gravity, push re im, rows; per row: n t g a p (re im each), psi, beta, error, variance
//     out: per step: F (rows n t p), Q upper triangle, joint covariance (12 by 12); then per step, smoothed: error (12),
//          covariance diagonal (12)
#include <stdio.h>

#include <vector>

#include "levelhead/smoother.hpp"

using namespace levelhead;
using S = double;

static S next() {
    S x = 0.0;
    if (scanf("%lf", &x) != 1) throw 1;
    return x;
}

static Complex<S> complex() {
    const S re = next(), im = next();
    return {re, im};
}

static void put(const Complex<S>& z) { printf("%.17g %.17g ", z.re, z.im); }

// Unit vectors of the joint errors: real parts of n t g a p, imaginary parts, psi, beta.
static Joint<S> unit(int i) {
    Joint<S> u{};
    Complex<S>* at[5] = {&u.x.n, &u.x.t, &u.x.g, &u.x.a, &u.x.p};
    if (i < 5) at[i]->re = 1.0;
    else if (i < 10) at[i - 5]->im = 1.0;
    else (i == 10 ? u.turn : u.bias) = 1.0;
    return u;
}

static void put(const Joint<S>& v) {
    const Complex<S>* at[5] = {&v.x.n, &v.x.t, &v.x.g, &v.x.a, &v.x.p};
    for (const Complex<S>* z : at) printf("%.17g ", z->re);
    for (const Complex<S>* z : at) printf("%.17g ", z->im);
    printf("%.17g %.17g ", v.turn, v.bias);
}

static void put(const PhasorCovariance<S>& p) {
    for (const Complex<S>& z : {Complex<S>{p.nn, 0}, p.nt, p.ng, p.na, p.np, Complex<S>{p.tt, 0}, p.tg, p.ta, p.tp, Complex<S>{p.gg, 0}, p.ga,
                                p.gp, Complex<S>{p.aa, 0}, p.ap, Complex<S>{p.pp, 0}})
        put(z);
}

static void get(PhasorCovariance<S>& p) {
    p.nn = complex().re; p.nt = complex(); p.ng = complex(); p.na = complex(); p.np = complex();
    p.tt = complex().re; p.tg = complex(); p.ta = complex(); p.tp = complex();
    p.gg = complex().re; p.ga = complex(); p.gp = complex();
    p.aa = complex().re; p.ap = complex();
    p.pp = complex().re;
}

int main() {
    SmootherRecord<S> r{};
    get(r.covariance);
    r.turning.xx = next(); r.turning.xb = next(); r.turning.bb = next();
    PhasorNoise<S> noise{};
    noise.gyro = next(); noise.accel = next(); noise.accel_walk = next();
    const S heading_noise = next();
    std::vector<SmootherRecord<S>> records;
    std::vector<Observation<S>> seen;
    const int steps = int(next());
    for (int k = 0; k < steps; ++k) {
        const S t = next(), phi = next(), g = next();
        const HeadingShare<S> push = pushed(complex(), t, true);
        Transition<S> f = transition(t, phi, g);
        add_position(f, t, phi, g);
        propagate_position(r.covariance, f);
        propagate_position(r.direction, f);
        propagate(r.covariance, f);
        propagate(r.direction, f);
        const auto add = [&](const PhasorVector<S>& v, S variance) {
            add_seen(r.covariance, v, variance);
            add_seen(r.direction, v, variance);
        };
        propagate(r.turning, r.share, add, f, push, true, t, heading_noise * t, 0.0);
        PhasorCovariance<S> q{};
        add_noise(q, noise, t, g);
        add_position_noise(q, noise, t, g);
        add_noise(r.covariance, noise, t, g);
        add_position_noise(r.covariance, noise, t, g);
        r.step = {f, push, t, 1.0, {t, 1.0, 1.0}};
        r.first = long(seen.size());
        r.count = long(next());
        for (long j = 0; j < r.count; ++j) {
            Row<S> row{};
            row.x.n = complex(); row.x.t = complex(); row.x.g = complex(); row.x.a = complex(); row.x.p = complex();
            row.turn = next(); row.bias = next();
            const S error = next(), variance = next();
            seen.push_back(row.turn == 1.0 && row.bias == 0.0 && norm2(row.x.n) + norm2(row.x.p) + norm2(row.x.g) == 0.0
                               ? observe_heading(r.turning, r.share, error, variance)
                               : observe(r.covariance, r.direction, r.turning, r.share, row, error, variance));
        }
        for (const Complex<S>& z : {f.nn, f.nt, f.ng, f.na, f.tt, f.tg, f.ta, f.pp, f.pn, f.pt, f.pg, f.pa}) put(z);
        put(q);
        for (int i = 0; i < 12; ++i) {
            const Joint<S> u = unit(i);
            put(times(r, u.x, u.turn, u.bias));
        }
        records.push_back(r);
    }
    Adjoint<S> a{};
    AdjointVariance<S> m{};
    for (int k = steps - 1; k >= 0; --k) {
        const SmootherRecord<S>& at = records[size_t(k)];
        put(times(at, a.x.x, a.x.turn, a.x.bias));
        for (int i = 0; i < 12; ++i) {
            const Joint<S> u = unit(i);
            printf("%.17g ", smoothed_variance(at, m, u.x, u.turn, u.bias));
        }
        for (long j = at.first + at.count - 1; j >= at.first; --j) {
            unobserve(a.x, seen[size_t(j)]);
            unobserve(m, seen[size_t(j)]);
        }
        unmove(a, at.step);
        unmove(m, at.step);
    }
    return 0;
}
