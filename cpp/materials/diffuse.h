// Lambertian reflection: f = albedo / pi on the side of the camera.
#pragma once

#include "core/mapping.h"

namespace veriray {

template <class F>
struct BsdfValue {
    Vec3<F> f_cos;  // f(wo, wi) |cos wi|
    F pdf_sa;
};

template <class F>
struct BsdfSample {
    Vec3<F> wi;      // local frame, z along the normal on wo's side
    Vec3<F> weight;  // f |cos| / pdf
    F pdf_sa;
};

template <class F>
struct Diffuse {
    Vec3<F> albedo;

    // cos_i = cosine of wi to the normal on wo's side; positive.
    VR_HD BsdfValue<F> eval(F cos_i) const {
        const F pdf = cosine_hemisphere_pdf_sa(cos_i);
        return {albedo * pdf, pdf};
    }
    VR_HD BsdfSample<F> sample(F u, F v) const {
        const Vec3<F> wi = cosine_hemisphere(u, v);
        return {wi, albedo, cosine_hemisphere_pdf_sa(wi.z)};
    }
};

}  // namespace veriray
