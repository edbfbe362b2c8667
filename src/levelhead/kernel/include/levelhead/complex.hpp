// Complex numbers for horizontal vectors: x + iy. Plain products, without the NaN rescue of the standard library.
#ifndef LEVELHEAD_COMPLEX_HPP
#define LEVELHEAD_COMPLEX_HPP

#include "scalar.hpp"

namespace levelhead {

template <class S>
struct Complex {
    S re, im;
};

template <class S>
Complex<S> operator+(const Complex<S>& a, const Complex<S>& b) { return {a.re + b.re, a.im + b.im}; }

template <class S>
Complex<S> operator-(const Complex<S>& a, const Complex<S>& b) { return {a.re - b.re, a.im - b.im}; }

template <class S>
Complex<S> operator-(const Complex<S>& a) { return {-a.re, -a.im}; }

template <class S>
Complex<S> operator*(const Complex<S>& a, const Complex<S>& b) {
    return {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
}

template <class S>
Complex<S> operator*(const Complex<S>& a, S s) { return {a.re * s, a.im * s}; }

template <class S>
Complex<S> conj(const Complex<S>& a) { return {a.re, -a.im}; }

template <class S>
Complex<S> times_i(const Complex<S>& a) { return {-a.im, a.re}; }

template <class S>
S norm2(const Complex<S>& a) { return a.re * a.re + a.im * a.im; }

// The real part of a conj(b).
template <class S>
S inner(const Complex<S>& a, const Complex<S>& b) { return a.re * b.re + a.im * b.im; }

}  // namespace levelhead

#endif
