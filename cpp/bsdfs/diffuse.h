// Lambert's reflection (J. H. Lambert, Photometria, 1760).
#pragma once

#include "bsdfs/closure.h"

namespace veriray {

template <class L>
struct Diffuse : Closure<L> {
    VR_CLOSURE(L);
    static constexpr const char* kName = "diffuse";
    static constexpr bool kScatters = true;
    static constexpr uint32_t kReads = parameter_bit(kParameter_reflectance);

    static VR_HD M black(const Parameters& p, M) { return max_channel(p.reflectance) <= F(0.f); }
    static VR_HD S albedo(const Parameters& p, const View&) { return p.reflectance; }
    static VR_HD Value eval(const Parameters& p, const View&, V, V, F cos_i) {
        const F pdf = cosine_hemisphere_pdf_sa(cos_i);
        return {p.reflectance * pdf, pdf};
    }
    static VR_HD Sample sample(const Parameters& p, const View& view, V, Numbers r, M nobody) {
        F cos_i;
        Sample s = cosine_lobe(view, r.u, r.v, cos_i, nobody);
        s.weight = p.reflectance;
        return s;
    }
};

}  // namespace veriray
