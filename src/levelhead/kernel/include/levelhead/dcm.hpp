// Direction cosine matrices: the exact rotation step, levelling, Euler angles, re-orthonormalisation.
#ifndef LEVELHEAD_DCM_HPP
#define LEVELHEAD_DCM_HPP

#include "vec3.hpp"

namespace levelhead {

// Rows x, y, z: row z of the body-to-NED matrix is "down" seen in the body frame.
template <class S>
struct Dcm {
    Vec3<S> x, y, z;
};

template <class S>
Dcm<S> identity() {
    return {{S(1), S(0), S(0)}, {S(0), S(1), S(0)}, {S(0), S(0), S(1)}};
}

template <class S>
Vec3<S> operator*(const Dcm<S>& c, const Vec3<S>& v) { return {dot(c.x, v), dot(c.y, v), dot(c.z, v)}; }

template <class S>
Vec3<S> transposed_times(const Dcm<S>& c, const Vec3<S>& v) { return c.x * v.x + c.y * v.y + c.z * v.z; }

template <class S, class Mask>
Dcm<S> select(Mask mask, const Dcm<S>& yes, const Dcm<S>& no) {
    return {select(mask, yes.x, no.x), select(mask, yes.y, no.y), select(mask, yes.z, no.z)};
}

// Coefficients of exp([phi x]) = I + a [phi x] + b [phi x]^2 with a = sin|phi|/|phi|, b = (1 - cos|phi|)/|phi|^2.
template <class S>
struct RotationCoefficients {
    S a, b;
};

template <class S>
LEVELHEAD_HOT RotationCoefficients<S> rotation_coefficients(S angle_squared) {
    const S q = angle_squared;
    // Below 0.25 rad these series are exact to the last bit of a double; the terms are 1/(2k+1)! and 1/(2k+2)!.
    S a = S(1) - q * (S(1.0 / 6) - q * (S(1.0 / 120) - q * (S(1.0 / 5040) - q * (S(1.0 / 362880) - q * S(1.0 / 39916800)))));
    S b = S(0.5) - q * (S(1.0 / 24) - q * (S(1.0 / 720) - q * (S(1.0 / 40320) - q * (S(1.0 / 3628800) - q * S(1.0 / 479001600)))));
    const auto large = q > S(0.0625);
    if (any(large)) {
        const S angle = square_root(maximum(q, S(0.0625)));
        const S half = sine(S(0.5) * angle);
        a = select(large, sine(angle) / angle, a);
        b = select(large, S(2) * half * half / (angle * angle), b);
    }
    return {a, b};
}

// C <- C exp([phi x]): the body turns by phi (body axes, rad).
template <class S>
LEVELHEAD_HOT Dcm<S> rotated_in_body(const Dcm<S>& c, const Vec3<S>& phi) {
    const RotationCoefficients<S> k = rotation_coefficients(dot(phi, phi));
    // row' = row + a (row x phi) + b ((row x phi) x phi), since row [phi x] = row x phi.
    const auto turned = [&](const Vec3<S>& row) {
        const Vec3<S> once = cross(row, phi);
        return row + once * k.a + cross(once, phi) * k.b;
    };
    return {turned(c.x), turned(c.y), turned(c.z)};
}

// C <- exp([phi x]) C: the platform axes turn by phi (navigation axes, rad).
template <class S>
Dcm<S> rotated_in_ned(const Dcm<S>& c, const Vec3<S>& phi) {
    return rotated_in_body(c, transposed_times(c, phi));
}

// One Newton step towards C C^T = I: C (3 I - C^T C) / 2. Kills rounding drift, leaves a rotation alone.
template <class S>
Dcm<S> orthonormalized(const Dcm<S>& c) {
    const S xx = dot(c.x, c.x), yy = dot(c.y, c.y), zz = dot(c.z, c.z);
    const S xy = S(0.5) * dot(c.x, c.y), xz = S(0.5) * dot(c.x, c.z), yz = S(0.5) * dot(c.y, c.z);
    return {c.x * (S(1.5) - S(0.5) * xx) - c.y * xy - c.z * xz,
            c.y * (S(1.5) - S(0.5) * yy) - c.x * xy - c.z * yz,
            c.z * (S(1.5) - S(0.5) * zz) - c.x * xz - c.y * yz};
}

template <class S>
S roll(const Dcm<S>& c) { return arc_tangent(c.z.y, c.z.z); }

template <class S>
S pitch(const Dcm<S>& c) { return arc_tangent(-c.z.x, square_root(c.z.y * c.z.y + c.z.z * c.z.z)); }

template <class S>
S heading(const Dcm<S>& c) { return arc_tangent(c.y.x, c.x.x); }

// Turn the platform about the vertical: heading grows by `angle`.
template <class S>
Dcm<S> turned_about_vertical(const Dcm<S>& c, S angle) {
    const S ca = cosine(angle), sa = sine(angle);
    return {c.x * ca - c.y * sa, c.x * sa + c.y * ca, c.z};
}

// The smallest rotation of the platform that carries direction `from` on to direction `to` (navigation axes).
template <class S>
Dcm<S> carried(const Dcm<S>& c, const Vec3<S>& from, const Vec3<S>& to) {
    const Vec3<S> axis = cross(from, to);
    const S along = dot(from, to), across = norm(axis);
    const S angle = arc_tangent(across, along);
    // Opposite vectors leave the axis open; any horizontal one will do.
    const auto opposite = (along < S(0)) & (across < S(-1e-6) * along);
    const Vec3<S> unit = select(opposite, Vec3<S>{S(1), S(0), S(0)}, axis * (S(1) / maximum(across, S(1e-30))));
    return rotated_in_ned(c, unit * angle);
}

// Level attitude from one specific force reading, heading 0: "up" is where the reading points.
template <class S>
Dcm<S> levelled(const Vec3<S>& specific_force) {
    const Vec3<S> up = {S(0), S(0), S(-1)};
    const auto upside_down = specific_force.z > S(0);
    // Start from the nearer of upright and rolled over, so that the smallest rotation is well defined.
    const Dcm<S> rolled_over = {{S(1), S(0), S(0)}, {S(0), S(-1), S(0)}, {S(0), S(0), S(-1)}};
    const Dcm<S> start = select(upside_down, rolled_over, identity<S>());
    return carried(start, start * specific_force, up);
}

}  // namespace levelhead

#endif
