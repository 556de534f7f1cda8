// The tree of lights, which the host builds.
#pragma once

#include <vector>

#include "lights/source.h"
#include "lights/tree_view.h"

namespace veriray {

struct LightTreeTable {
    std::vector<float> branches;  // [branch][kBranchFloats]
    std::vector<uint32_t> leaf;   // by light: its branch
    uint32_t root = 0;            // how many branches the root has, the first ones
};
// power: by light, its flux. The same on every machine.
LightTreeTable build_light_tree(const std::vector<LightBound>& lights,
                                const std::vector<double>& power);

}  // namespace veriray
