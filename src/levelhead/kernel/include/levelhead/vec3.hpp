// Three-component vectors.
#ifndef LEVELHEAD_VEC3_HPP
#define LEVELHEAD_VEC3_HPP

#include "scalar.hpp"

namespace levelhead {

template <class S>
struct Vec3 {
    S x, y, z;
};

template <class S>
Vec3<S> operator+(const Vec3<S>& a, const Vec3<S>& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }

template <class S>
Vec3<S> operator-(const Vec3<S>& a, const Vec3<S>& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }

template <class S>
Vec3<S> operator*(const Vec3<S>& a, S s) { return {a.x * s, a.y * s, a.z * s}; }

template <class S>
S dot(const Vec3<S>& a, const Vec3<S>& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

template <class S>
Vec3<S> cross(const Vec3<S>& a, const Vec3<S>& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

template <class S>
S norm(const Vec3<S>& a) { return square_root(dot(a, a)); }

template <class S, class Mask>
Vec3<S> select(Mask mask, const Vec3<S>& yes, const Vec3<S>& no) {
    return {select(mask, yes.x, no.x), select(mask, yes.y, no.y), select(mask, yes.z, no.z)};
}

}  // namespace levelhead

#endif
