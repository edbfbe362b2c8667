// How the phasor filter starts: levelling and what it is worth, velocities from positions alone, the first heading. Functions
// on the filter `f`.
#ifndef LEVELHEAD_PHASOR_START_HPP
#define LEVELHEAD_PHASOR_START_HPP

#include "earth.hpp"
#include "phasor_params.hpp"

namespace levelhead {

// The heading that the user knew serves once, where the course tells none.
template <class Filter, class S>
bool known_heading(Filter& f, const PhasorParams<S>& k, const Sighting<S>& e) {
    PlatformState<S>& p = f.platform;
    const bool use = !e.trusted && !(f.started > S(0.5)) && k.heading_std > S(0);
    f.started = S(1);
    if (!use) return false;
    p.dcm_body_to_ned = turned_about_vertical(p.dcm_body_to_ned, wrap_angle(k.heading - heading(p.dcm_body_to_ned)));
    p.heading_known = S(1);
    return true;
}

// From positions alone: a velocity from the way since the anchor, half of its turn later, and how wrong it can be.
template <class Filter, class S>
bool from_positions(Filter& f, const PhasorParams<S>& k, Fix<S>& fix) {
    const Dcm<S>& c = f.platform.dcm_body_to_ned;
    const Geodetic imu = moved(fix.position, widened(c * k.platform.lever_arm * S(-1)));
    const S age = f.anchor.age, turn = f.anchor.turn + f.platform.turn;
    const bool first = !known(f.anchor.place);
    if (!first && age < S(align_time) * S(0.999)) return false;
    const Geodetic before = f.anchor.place;
    f.anchor = {imu, S(0), S(0)};
    if (first) return false;
    const S length = maximum(age, S(1e-3));
    const Vec3<S> mean = narrowed<S>(offset_ned(before, imu)) * (S(1) / length);
    const Complex<S> later = Complex<S>{mean.x, mean.y} * Complex<S>{cosine(S(0.5) * turn), sine(S(0.5) * turn)};
    // Seen as the antenna's velocity, from which the swing of the arm will be taken off.
    fix.velocity = Vec3<S>{later.re, later.im, mean.z} + c * cross(f.platform.angular_rate, k.platform.lever_arm);
    const S bend = S(0.5) * S(hidden_accel) * length, curve = S(0.25) * turn * turn * square_root(norm2(later));
    const auto std = [&](S position_std) {
        return square_root(S(2) * f.position_variance(k, position_std) / (length * length) + bend * bend + curve * curve);
    };
    const S level = std(horizontal_std(fix.position_std));
    fix.std = {level, level, std(fix.position_std.z)};
    fix.has_velocity = true;
    return true;
}

template <class S>
void forget_motion(PhasorCovariance<S>& p) {
    p.nn = p.tt = p.pp = S(0);
    p.nt = p.ng = p.na = p.tg = p.ta = p.np = p.tp = p.gp = p.ap = {S(0), S(0)};
}

// After levelling, what the accelerometers read amiss is in the tilt: theta = i (mean of beta_a - dn/T) / g, plus what the
// gyro bias has turned since. In a turn the mean of a bias is not the bias: the integrals are those of a transition. `told`: the
// heading is the user's.
template <class Filter, class S>
void align_covariance(Filter& f, const PhasorParams<S>& k, const Sighting<S>& e, const Fix<S>& fix, bool told) {
    PhasorCovariance<S>& p = f.horizontal;
    const S over_g = S(1) / f.gravity, half = S(0.5) * fix.length, phi = f.platform.turn;
    const Transition<S> through = transition(fix.length, phi, f.gravity);
    const S r = f.velocity_variance(k, horizontal_std(fix.std));
    f.azimuth = {S(1), S(0)};
    f.yaw_rate = phi * e.rate;
    f.platform.turn = f.elapsed = f.gap_tilt = f.gap_velocity = f.tracked = S(0);
    f.platform.velocity_ned = e.velocity;
    f.feel_the_earth(k, S(0));
    Transition<S> t{};
    t.tg = times_i(conj(through.ng * conj(through.nn))) * (over_g * e.rate);
    t.ta = times_i(through.na) * (over_g * e.rate);
    f.direction = PhasorDirection<S>{};
    forget_motion(p);
    propagate(p, t);
    f.turning.xx = e.trusted ? f.course_variance(k, e, fix, S(1)) : told ? k.heading_std * k.heading_std : S(unknown_heading_var);
    f.turning.xb = S(0);
    // Levelling on an acceleration seen from a wrong heading tilts the platform: theta = -f psi / g.
    const Complex<S> lean = Complex<S>{e.gnss_force.x, e.gnss_force.y} * -over_g;
    p.tt = p.tt + (S(2) * r * e.rate * e.rate + k.noise.accel * e.rate) * over_g * over_g + k.noise.gyro * half +
           (e.trusted || told ? S(0) : norm2(lean));
    p.nn = r;
    p.nt = {S(0), r * e.rate * over_g};
    f.share = HeadingShare<S>{};
    if (e.trusted || told) f.share.x.t = lean;
    f.recorder.moved(f, t, HeadingShare<S>{}, fix.length, S(0), LiftStep<S>{S(0), S(0), S(0)});
    f.lifting = {f.velocity_variance(k, fix.std.z), S(0), f.lifting.bb, S(0), S(0), S(0)};
    if (e.trusted) f.since_steered = S(0);
}

// Without a heading: the velocity is what the fix says, the tilt and the biases stay.
template <class Filter, class S>
void take_velocity(Filter& f, const PhasorParams<S>& k, const Vec3<S>& velocity, const Fix<S>& fix) {
    const bool positions = f.tracked > S(0.5);
    Transition<S> t{};
    t.tt = t.pp = {S(1), S(0)};
    if (positions) propagate_position(f.horizontal, t);
    propagate(f.horizontal, t);
    f.direction = PhasorDirection<S>{};  // before the heading is known nothing has a direction
    f.horizontal.nn = f.velocity_variance(k, horizontal_std(fix.std));
    f.lifting.vv = f.velocity_variance(k, fix.std.z);
    f.lifting.vb = f.lifting.dv = S(0);
    f.platform.velocity_ned = velocity;
    f.share.x.n = f.share.b.n = {S(0), S(0)};
    f.recorder.moved(f, t, HeadingShare<S>{}, S(0), S(1), LiftStep<S>{S(0), S(0), positions ? S(1) : S(0)});
}

// How far the vehicle may have turned before its first course, that what the gyros read of the Earth can be told, rad; and
// the cosine up to which the net turn counts as less.
constexpr double hardly_turned = 0.2, hardly_turned_cosine = 0.98;

// The first course; `angle` is what sight() has turned the heading by.
template <class Filter, class S>
void take_course(Filter& f, const PhasorParams<S>& k, const Sighting<S>& e, const Fix<S>& fix, S angle) {
    f.share = HeadingShare<S>{};
    f.recorder.observed(observe_heading(f.turning, f.share, -angle, f.course_variance(k, e, fix, S(1))));
    f.since_steered = S(0);
    // Until now the Earth's horizontal rate had no direction and went into the gyro bias: as much of it as that has learnt.
    // Where the vehicle has hardly turned meanwhile the Earth can now be told apart, else the bias is that much less sure.
    const Vec3<S> turn = frame_rate(f.latitude(k), f.platform.velocity_ned).turn;
    const S rate2 = turn.x * turn.x + turn.y * turn.y, prior = k.initial_gyro_bias_std * k.initial_gyro_bias_std;
    const Complex<S> before = f.azimuth * Complex<S>{cosine(angle), -sine(angle)};
    const S learnt = clamp(S(1) - f.horizontal.gg / prior, S(0), S(1));
    if (before.re > S(hardly_turned_cosine)) {
        f.gyro_bias = f.gyro_bias - transposed_times(f.platform.dcm_body_to_ned, {turn.x * learnt, turn.y * learnt, S(0)});
        f.horizontal.gg = f.horizontal.gg + S(0.5 * hardly_turned * hardly_turned) * rate2 * learnt * learnt;
    } else {
        f.horizontal.gg = f.horizontal.gg + S(0.5) * rate2;
    }
}

}  // namespace levelhead

#endif
