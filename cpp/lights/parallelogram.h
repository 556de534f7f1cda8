// Parallelograms, from a corner along two edges.
#pragma once

#include "lights/flat.h"

namespace veriray {

template <class L>
struct ParallelogramLight : FlatLight<L, ParallelogramLight<L>> {
    static constexpr const char *kName = "parallelogram", *kFeature = "area_lights";
};

}  // namespace veriray
