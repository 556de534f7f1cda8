// A principled surface that lets light through.
#pragma once

#include "bsdfs/principled.h"

namespace veriray {

template <class L>
struct OpenPrincipled : PrincipledLobes<L, true> {
    static constexpr const char* kName = "principled_open";
};

}  // namespace veriray
