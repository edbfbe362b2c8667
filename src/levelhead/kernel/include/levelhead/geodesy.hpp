// Places on the WGS-84 ellipsoid, always in double: a radian of latitude in a float is half a metre wide.
#ifndef LEVELHEAD_GEODESY_HPP
#define LEVELHEAD_GEODESY_HPP

#include "vec3.hpp"

namespace levelhead {

struct Geodetic {
    double latitude, longitude, height;  // rad, rad, m above the ellipsoid; NaN where unknown
};

inline bool known(const Geodetic& p) { return (p.latitude * 0.0 + p.longitude * 0.0) + p.height * 0.0 == 0.0; }

constexpr double semi_major_axis = 6378137.0;             // m
constexpr double eccentricity_squared = 6.69437999014e-3;

struct Radii {
    double meridian, normal;  // of curvature: along the meridian, and across it, m
};

inline Radii radii_of_curvature(double latitude) {
    const double sin_lat = ::sin(latitude), w = 1.0 - eccentricity_squared * sin_lat * sin_lat;
    const double normal = semi_major_axis / ::sqrt(w);
    return {normal * (1.0 - eccentricity_squared) / w, normal};
}

// From one place to another, in the NED frame of their midpoint, m: third order in the distance.
inline Vec3<double> offset_ned(const Geodetic& from, const Geodetic& to) {
    const double middle = 0.5 * (from.latitude + to.latitude), height = 0.5 * (from.height + to.height);
    const Radii r = radii_of_curvature(middle);
    double east = to.longitude - from.longitude;  // over the date line, too
    east -= 2.0 * pi * ::floor(east / (2.0 * pi) + 0.5);
    return {(to.latitude - from.latitude) * (r.meridian + height), east * (r.normal + height) * ::cos(middle), from.height - to.height};
}

// A step away by this much, m: north first, then east along the parallel halfway.
inline Geodetic moved(const Geodetic& p, const Vec3<double>& ned) {
    const Radii r = radii_of_curvature(p.latitude);
    const double height = p.height - 0.5 * ned.z, north = ned.x / (r.meridian + height);
    // Within a kilometre of a pole longitude means nothing that a vehicle could steer by.
    const double parallel = (r.normal + height) * maximum(::cos(p.latitude + 0.5 * north), 1e-4);
    double longitude = p.longitude + ned.y / parallel;
    longitude -= 2.0 * pi * ::floor(longitude / (2.0 * pi) + 0.5);
    return {p.latitude + north, longitude, p.height - ned.z};
}

// Gravity on the ellipsoid (Somigliana) less the free-air gradient, m/s^2; the real one is within 1e-3 of it.
inline double normal_gravity(double latitude, double height) {
    const double sin_lat = ::sin(latitude), sine2 = sin_lat * sin_lat;
    return 9.7803253359 * (1.0 + 1.931852652e-3 * sine2) / ::sqrt(1.0 - eccentricity_squared * sine2) - 3.086e-6 * height;
}

template <class S>
Vec3<S> narrowed(const Vec3<double>& v) { return {S(v.x), S(v.y), S(v.z)}; }

template <class S>
Vec3<double> widened(const Vec3<S>& v) { return {double(v.x), double(v.y), double(v.z)}; }

}  // namespace levelhead

#endif
