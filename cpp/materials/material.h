// The closed list of materials. A new one: its header, a kind here, a branch in visit(), the Python
// factory and a test case.
#pragma once

#include "materials/diffuse.h"

namespace veriray {

enum class MaterialKind : uint32_t { kDiffuse };

// Calls fn with the material of this kind.
template <class F, class Fn>
VR_HD void visit(MaterialKind, Vec3<F> albedo, Fn fn) {
    fn(Diffuse<F>{albedo});
}

}  // namespace veriray
