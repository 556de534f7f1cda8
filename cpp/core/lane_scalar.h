// One lane: any processor.
#pragma once

namespace veriray {

using Simd = Scalar;

VR_HD bool first_lanes(uint32_t n, bool) { return n > 0; }
template <class T>
VR_HD void compress_store(T* p, T a, bool m) {
    if (m) *p = a;
}

}  // namespace veriray
