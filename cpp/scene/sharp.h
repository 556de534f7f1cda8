// What surfaces make of parallel light, which the film's resolution goes by.
#pragma once

#include "scene/scene.h"

namespace veriray {

// Whether a rough surface may send on parallel light with more than 2^20 times its irradiance.
bool any_sharp(const SceneInput& in);

}  // namespace veriray
