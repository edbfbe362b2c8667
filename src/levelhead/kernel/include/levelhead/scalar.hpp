// The few scalar operations that the kernel needs, as overloads: another scalar type (a SIMD pack, a fixed-point
// number) joins in by overloading the same names. A mask is what a comparison of two scalars gives.
#ifndef LEVELHEAD_SCALAR_HPP
#define LEVELHEAD_SCALAR_HPP

#include <math.h>
#include <stdint.h>

// For what runs at every sample: compilers judge it too large to inline, and a call costs a third of the work.
#if defined(_MSC_VER) && !defined(__clang__)
#define LEVELHEAD_HOT __forceinline
#else
#define LEVELHEAD_HOT __attribute__((always_inline)) inline
#endif

namespace levelhead {

constexpr double pi = 3.14159265358979323846;
constexpr double standard_gravity = 9.80665;

// select instead of if: SIMD lanes, GPU threads and microcontrollers then run the same lines.
inline float select(bool mask, float yes, float no) { return mask ? yes : no; }
inline double select(bool mask, double yes, double no) { return mask ? yes : no; }

// any guards rare, dear work: `if (any(mask))` is true when at least one lane needs it.
inline bool any(bool mask) { return mask; }

inline float square_root(float x) { return ::sqrtf(x); }
inline double square_root(double x) { return ::sqrt(x); }
inline float sine(float x) { return ::sinf(x); }
inline double sine(double x) { return ::sin(x); }
inline float cosine(float x) { return ::cosf(x); }
inline double cosine(double x) { return ::cos(x); }
inline float exponential(float x) { return ::expf(x); }
inline double exponential(double x) { return ::exp(x); }
inline float arc_tangent(float y, float x) { return ::atan2f(y, x); }
inline double arc_tangent(double y, double x) { return ::atan2(y, x); }

template <class S>
S absolute(S x) { return select(x < S(0), -x, x); }

template <class S>
S minimum(S a, S b) { return select(b < a, b, a); }

template <class S>
S maximum(S a, S b) { return select(a < b, b, a); }

template <class S>
S clamp(S x, S low, S high) { return minimum(maximum(x, low), high); }

// Angle in (-pi, pi] for |x| < 3 pi: all differences of two wrapped angles.
template <class S>
S wrap_angle(S x) {
    x = select(x > S(pi), x - S(2.0 * pi), x);
    return select(x <= S(-pi), x + S(2.0 * pi), x);
}

}  // namespace levelhead

#endif
