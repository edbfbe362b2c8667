// What makes a navigator of the phasor filter: positions, rest, an axle that does not slide, wheels. Functions on the filter
// `f`, each of which turns what it knows into rows of the joint errors.
#ifndef LEVELHEAD_PHASOR_NAVIGATE_HPP
#define LEVELHEAD_PHASOR_NAVIGATE_HPP

#include "phasor_params.hpp"
#include "standstill.hpp"

namespace levelhead {

// One sigma beyond the gate makes a measurement worth so much less that it becomes just possible.
template <class S>
S doubted(S error, S variance) { return maximum(error * error / (S(gate_one) * variance), S(1)); }

// A horizontal unit vector of the level frame along the direction of travel.
template <class Filter>
auto travel_direction(const Filter& f) {
    using S = typename Filter::Scalar;
    const Complex<S> v = f.to_level(f.platform.velocity_ned.x, f.platform.velocity_ned.y);
    const S speed = square_root(norm2(v));
    return speed > S(0.1) ? v * (S(1) / speed) : Complex<S>{S(1), S(0)};
}

// The filter's position begins here: at the fix, as sure as the fix.
template <class Filter, class S>
void begin_position(Filter& f, const PhasorParams<S>& k, const Fix<S>& fix) {
    const Vec3<S> arm = f.platform.dcm_body_to_ned * k.platform.lever_arm;
    f.recorder.done(f);
    f.tracked = S(1);
    f.direct();
    f.implausible = S(0);
    f.place = moved(fix.position, widened(arm * S(-1)));
    f.shift = {S(0), S(0), S(0)};
    // What the tilt and the heading do to the arm goes into the position; what the stamp does, too.
    Transition<S> t{};
    t.nn = t.tt = {S(1), S(0)};
    t.pt = {S(0), arm.z};
    HeadingShare<S> push{};
    if (f.platform.heading_known > S(0.5)) push.x.p = times_i(f.to_level(arm.x, arm.y)) * S(-1);
    propagate_position(f.horizontal, t);
    propagate_position(f.direction, t);
    f.share.x.p = t.pt * f.share.x.t + push.x.p;
    f.share.b.p = t.pt * f.share.b.t;
    const Vec3<S>& v = f.platform.velocity_ned;
    const S late = k.timing_std * k.timing_std;
    f.horizontal.pp = f.horizontal.pp + f.position_variance(k, horizontal_std(fix.position_std)) + S(0.5) * late * (v.x * v.x + v.y * v.y);
    f.lifting.dd = f.position_variance(k, fix.position_std.z) + late * v.z * v.z;
    f.lifting.dv = f.lifting.db = S(0);
    f.recorder.moved(f, t, push, S(0), S(1), LiftStep<S>{S(0), S(1), S(0)});
}

// A position of the antenna. Along the way it is as wrong as its stamp, besides.
template <class Filter, class S>
void observe_position(Filter& f, const PhasorParams<S>& k, const Fix<S>& fix) {
    const Vec3<S> arm = f.platform.dcm_body_to_ned * k.platform.lever_arm;
    const Vec3<S> error = narrowed<S>(offset_ned(fix.position, f.place)) + arm;
    const Complex<S> z = f.to_level(error.x, error.y), lever = f.to_level(arm.x, arm.y), ahead = travel_direction(f);
    const Vec3<S>& v = f.platform.velocity_ned;
    const S r = f.position_variance(k, horizontal_std(fix.position_std)), r_down = f.position_variance(k, fix.position_std.z);
    const S late = k.timing_std * k.timing_std;
    const auto row = [&](const Complex<S>& l) {
        // The antenna's error is pi - i L_z theta + i L psi, seen along l.
        Row<S> out{};
        out.x.p = l;
        out.x.t = times_i(l) * arm.z;
        out.turn = inner(l, times_i(lever));
        return out;
    };
    const Row<S> along = row(ahead), across = row(times_i(ahead));
    const S z_along = inner(ahead, z), z_across = inner(times_i(ahead), z);
    const S r_along = r + (v.x * v.x + v.y * v.y) * late, r_lift = r_down + v.z * v.z * late;
    const S s_along = f.spread(along, r_along), s_across = f.spread(across, r), s_down = f.lifting.dd + r_lift;
    // A clock that is off shows along the way only, and must not cost the rest its trust; an outlier shows everywhere.
    const S aside = maximum(doubted(z_across, s_across), doubted(error.z, s_down)), d = maximum(doubted(z_along, s_along), aside);
    f.implausible = d > S(jump_doubt) ? f.implausible + fix.length : S(0);
    if (f.implausible > S(jump_time)) {
        f.jumps = f.jumps + S(1);
        return begin_position(f, k, fix);
    }
    f.surprises = minimum(f.surprises + S(1), S(1e5));
    f.surprise = f.surprise + (S(0.5) * (z_along * z_along / (s_along * d) + z_across * z_across / (s_across * aside)) - f.surprise) / f.surprises;
    f.take(along, across, z_along, z_across, r_along + (d - S(1)) * s_along, r + (aside - S(1)) * s_across,
           observe_position(f.lifting, error.z, r_lift + (aside - S(1)) * s_down));
}

template <class Filter, class S>
void locate(Filter& f, const PhasorParams<S>& k, const Fix<S>& fix) {
    if (!fix.has_position) return;
    // Before the heading is known the filter learns nothing on the move, and follows.
    if (f.tracked > S(0.5) && f.platform.heading_known > S(0.5)) {
        observe_position(f, k, fix);
    } else {
        begin_position(f, k, fix);
    }
}

// Nor does it leave the ground: it moves along one direction of the body, which is learnt while GNSS tells the velocity, so
// that the mounting does not matter; the attitude then tells how steep the way is. The tilt's error stays for long, and one
// that the vertical cannot share with the horizontal: looks within that time count as one.
template <class Filter, class S>
void follow_slope(Filter& f, const PhasorParams<S>& k, const Vec3<S>& v, bool gnss) {
    const PlatformState<S>& p = f.platform;
    const S level2 = v.x * v.x + v.y * v.y, speed = norm(v) * (p.reverse > S(0.5) ? S(-1) : S(1));
    const S tilt = f.horizontal.tt + shared_variance(f.turning, f.share.x.t, f.share.b.t);
    const S since = maximum(f.since_constrained, S(1e-3)), sag = k.sideslip_std * k.sideslip_std;
    const S looks = maximum(S(1), S(2.0 * tilt_time) / since);
    if (gnss) {
        const S r = (f.lifting.vv / level2 + tilt + sag) * looks, gain = f.travel_var / (f.travel_var + r);
        f.travel = f.travel + (transposed_times(p.dcm_body_to_ned, v) * (S(1) / speed) - f.travel) * gain;
        f.travel_var = r * gain;
    }
    const S down = dot(p.dcm_body_to_ned.z, f.travel), own = f.horizontal.nn * down * down;
    const S r = (level2 * (tilt + f.travel_var + sag)) * looks + own, error = v.z - speed * down;
    f.apply(f.lifted(observe_velocity(f.lifting, error, r + (doubted(error, f.lifting.vv + r) - S(1)) * (f.lifting.vv + r))));
}

// The axle that does not steer rolls where it points: its sideways velocity, v sin(course - heading), is none.
template <class Filter, class S>
void constrain(Filter& f, const PhasorParams<S>& k, bool gnss) {
    const PlatformState<S>& p = f.platform;
    const Vec3<S> v = p.velocity_ned + p.dcm_body_to_ned * cross(p.angular_rate, k.rear_axle);
    const S speed2 = v.x * v.x + v.y * v.y;
    if (!(speed2 > k.platform.min_course_speed * k.platform.min_course_speed)) return;
    const S angle = course_innovation(f.platform, true, arc_tangent(v.y, v.x));
    const S speed = square_root(speed2) * (p.reverse > S(0.5) ? S(-1) : S(1)), facing = heading(p.dcm_body_to_ned);
    // Many looks tell no more about a slide that stays than one.
    const S looks = maximum(S(1), S(2.0 * sideslip_time) / maximum(f.since_constrained, S(1e-3)));
    const S slide = k.sideslip_std * k.sideslip_std * speed2 + k.axle_std * k.axle_std * f.yaw_rate * f.yaw_rate;
    Row<S> row{};
    row.x.n = times_i(f.to_level(cosine(facing), sine(facing)));
    row.turn = -speed;
    const S error = speed * angle, s = f.spread(row, slide * looks), d = doubted(error, s);
    f.direct();
    f.take(row, error, slide * looks + (d - S(1)) * s);
    if (k.constrained) follow_slope(f, k, f.platform.velocity_ned + p.dcm_body_to_ned * cross(p.angular_rate, k.rear_axle), gnss);
    f.since_constrained = f.since_steered = S(0);
}

// Wheels tell the speed ahead, but for the radius of the tyre, which GNSS teaches.
template <class Filter, class S>
void roll_on(Filter& f, const PhasorParams<S>& k, bool gnss) {
    const PlatformState<S>& p = f.platform;
    const S facing = heading(p.dcm_body_to_ned), reading = f.wheel_speed;
    const Vec3<S> v = p.velocity_ned + p.dcm_body_to_ned * cross(p.angular_rate, k.rear_axle);
    Row<S> row{};
    row.x.n = f.to_level(cosine(facing), sine(facing));
    const S ahead = v.x * cosine(facing) + v.y * sine(facing), noise = k.wheel_std * k.wheel_std;
    if (gnss && absolute(reading) > k.platform.min_course_speed) {
        // The filter's velocity errs for seconds at a time, so a look counts for a part of one.
        const S r = (f.spread(row, noise)) * S(10), w = f.wheel_scale_var, total = reading * reading * w + r;
        f.wheel_scale = f.wheel_scale + w * reading / total * (ahead - f.wheel_scale * reading);
        f.wheel_scale_var = w * r / total;
    }
    const S variance = noise + reading * reading * f.wheel_scale_var;
    const S error = ahead - f.wheel_scale * reading, s = f.spread(row, variance), d = doubted(error, s);
    f.direct();
    f.take(row, error, variance + (d - S(1)) * s);
}

// A second is over: was the vehicle at rest? Then it has no velocity, and what the gyros read is bias and the Earth. Each
// residual is taken after the correction before it, which may have changed the bias.
template <class Filter, class S>
void rest_now(Filter& f, const PhasorParams<S>& k) {
    const PlatformState<S>& p = f.platform;
    const Vec3<S> v = p.velocity_ned, mean = f.rest.mean_rate();
    f.rest.judge(f.gyro_bias, square_root(f.horizontal.gg + f.turning.bb), v.x * v.x + v.y * v.y, f.horizontal.nn);
    const S time = f.rest.time;
    const bool still = f.rest.still > S(0.5);
    f.rest.next(v.x * v.x + v.y * v.y);
    if (!still) return;
    const auto left = [&] { return p.dcm_body_to_ned * (mean - f.gyro_bias) - p.control_rate_ned; };
    Row<S> one{}, two{}, down{};
    one.x.n = {S(1), S(0)};
    two.x.n = {S(0), S(1)};
    const Complex<S> z = f.to_level(v.x, v.y);
    const S none = S(rest_velocity_std * rest_velocity_std), slow = none * doubted(square_root(norm2(z)), f.spread(one, none));
    f.take(one, two, z.re, z.im, slow, slow, observe_velocity(f.lifting, v.z, none));
    one = two = Row<S>{};
    one.x.g = {S(1), S(0)};
    two.x.g = {S(0), S(1)};
    down.bias = S(1);
    const Vec3<S> rate = left();
    const Complex<S> turn = f.to_level(rate.x, rate.y);
    const S noise = k.noise.gyro / time;
    const S d = maximum(doubted(square_root(norm2(turn)), f.spread(one, noise)), doubted(rate.z, f.spread(down, noise)));
    f.take(one, two, turn.re, turn.im, noise * d, noise * d);
    f.take(down, left().z, noise * d);
}

}  // namespace levelhead

#endif
