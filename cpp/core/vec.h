// Three-vectors of lanes. Sums of products are fused in one fixed order.
#pragma once

#include "core/lane.h"

namespace veriray {

template <class F>
struct Vec3 {
    F x, y, z;
};

template <class F>
VR_HD Vec3<F> operator+(Vec3<F> a, Vec3<F> b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class F>
VR_HD Vec3<F> operator-(Vec3<F> a, Vec3<F> b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class F>
VR_HD Vec3<F> operator-(Vec3<F> a) {
    return {-a.x, -a.y, -a.z};
}
template <class F>
VR_HD Vec3<F> operator*(Vec3<F> a, F s) {
    return {a.x * s, a.y * s, a.z * s};
}
template <class F>
VR_HD Vec3<F> fma(Vec3<F> a, F s, Vec3<F> b) {
    return {fma(a.x, s, b.x), fma(a.y, s, b.y), fma(a.z, s, b.z)};
}
// By component.
template <class F>
VR_HD Vec3<F> fma(Vec3<F> a, Vec3<F> b, Vec3<F> c) {
    return {fma(a.x, b.x, c.x), fma(a.y, b.y, c.y), fma(a.z, b.z, c.z)};
}
template <class F>
VR_HD F dot(Vec3<F> a, Vec3<F> b) {
    return fma(a.z, b.z, fma(a.y, b.y, a.x * b.x));
}
template <class F>
VR_HD Vec3<F> cross(Vec3<F> a, Vec3<F> b) {
    return {fma(a.y, b.z, -(a.z * b.y)), fma(a.z, b.x, -(a.x * b.z)), fma(a.x, b.y, -(a.y * b.x))};
}
// One Newton step towards unit length, for a vector of nearly unit length: directions computed from
// directions do not drift.
template <class F>
VR_HD Vec3<F> renormalised(Vec3<F> a) {
    return a * fma(F(-0.5f), dot(a, a), F(1.5f));
}
template <class F, class M>
VR_HD Vec3<F> select(M m, Vec3<F> a, Vec3<F> b) {
    return {select(m, a.x, b.x), select(m, a.y, b.y), select(m, a.z, b.z)};
}
// A vector from three consecutive floats (equal in all lanes) or lanes.
template <class F, class Number>
VR_HD Vec3<F> broadcast(const Number* p) {
    return {F(p[0]), F(p[1]), F(p[2])};
}

}  // namespace veriray
