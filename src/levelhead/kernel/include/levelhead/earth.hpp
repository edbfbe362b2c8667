// The Earth under the vehicle: how the local North, East, Down frame turns, for filters that know their latitude.
#ifndef LEVELHEAD_EARTH_HPP
#define LEVELHEAD_EARTH_HPP

#include "vec3.hpp"

namespace levelhead {

constexpr double earth_rate = 7.292115e-5;  // rad/s
// A sphere will do: the transport rate of a land vehicle is a hundredth of the Earth's, its flattening a hundredth of that.
constexpr double earth_radius = 6.371e6;  // m

template <class S>
struct FrameRate {
    Vec3<S> turn;      // of the NED frame in inertial space: Earth rate plus transport rate, rad/s
    Vec3<S> coriolis;  // twice the Earth rate plus the transport rate: a moving body feels -coriolis x v, rad/s
};

// All zero where the latitude (rad) is unknown, that is NaN.
template <class S>
FrameRate<S> frame_rate(S latitude, const Vec3<S>& velocity) {
    if (!(latitude * S(0) == S(0))) return {{S(0), S(0), S(0)}, {S(0), S(0), S(0)}};
    const S sin_lat = sine(latitude), cos_lat = cosine(latitude);
    const Vec3<S> earth = Vec3<S>{cos_lat, S(0), -sin_lat} * S(earth_rate);
    const S east = velocity.y * S(1.0 / earth_radius), north = velocity.x * S(1.0 / earth_radius);
    // At the pole "North" spins as the vehicle passes; within 60 km of it this follows no longer.
    const Vec3<S> transport = {east, -north, -east * sin_lat / maximum(cos_lat, S(0.01))};
    return {earth + transport, earth * S(2) + transport};
}

}  // namespace levelhead

#endif
