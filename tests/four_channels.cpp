// Closures of four channels (spectrum/spectrum.h with another kChannels): a colour whose channels
// are reversed gives values whose channels are reversed, and the same densities.
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "backends/bsdf_hooks.h"
#include "bsdfs/called.cpp"

using namespace veriray;
using S = Spectrum<float>;
static_assert(kChannels == 4 && sizeof(S) == 4 * sizeof(float));

float uniform() { return static_cast<float>(std::rand() % 4096) / 4096.f; }

S reversed(const S& s) {
    return S::of([&](uint32_t k) { return s[kChannels - 1 - k]; });
}

bool near(float a, float b) { return std::fabs(a - b) <= 1e-5f * std::fmax(std::fabs(a), 1e-3f); }

bool near(const S& a, const S& b) {
    return near(a[0], b[0]) && near(a[1], b[1]) && near(a[2], b[2]) && near(a[3], b[3]);
}

int main() {
    int wrong = 0, scattered[kMaterialCount] = {};
    for (uint32_t kind = 0; kind < kMaterialCount; ++kind) {
        for (int trial = 0; trial < 200; ++trial) {
            float x[kBsdfInputs];
            HookTable<Scalar> table;
            for (float& v : x) v = 0.1f + 0.8f * uniform();
            x[0] = static_cast<float>(kind), x[1] = 1.f, x[5] = 1.5f, x[9] = trial % 2 ? 1.f : 0.f;
            x[13] = x[15] = 0.f;  // hues are of red, green and blue: principled_parts.h
            x[21] = 0.f, x[22] = 0.f, x[23] = 1.f, x[24] = 0.6f, x[25] = 0.f, x[26] = 0.8f;
            auto a = bsdf_of<Scalar>(x, table);
            auto& p = a.parameters;
            const auto colour = [](uint32_t) { return 0.1f + 0.8f * uniform(); };
            p.reflectance = S::of(colour), p.k = S::of(colour);
            p.specular_reflectance = S::of(colour), p.specular_transmittance = S::of(colour);
            auto b = a;
            b.parameters.reflectance = reversed(p.reflectance), b.parameters.k = reversed(p.k);
            b.parameters.specular_reflectance = reversed(p.specular_reflectance);
            b.parameters.specular_transmittance = reversed(p.specular_transmittance);
            const Vec3<float> wo{x[24], x[25], x[26]};
            const BsdfNumbers<float> r{uniform(), uniform(), uniform()};
            const auto s = a.sample(wo, r), t = b.sample(wo, r);
            const float height = dot(a.view.n, s.wi);
            const float cos_i = a.transmits() ? height : std::fmax(height, 0.f);
            const auto v = a.eval(wo, s.wi, cos_i), w = b.eval(wo, s.wi, cos_i);
            wrong += !near(reversed(v.f_cos), w.f_cos) || !near(v.pdf_sa, w.pdf_sa);
            wrong += !near(reversed(a.albedo()), b.albedo());
            wrong += !near(reversed(a.pass_through()), b.pass_through());
            // Which lobe is drawn may depend on the order of channels by rounding alone.
            if (near(s.wi.x, t.wi.x)) wrong += !near(reversed(s.weight), t.weight);
            scattered[kind] += s.weight[3] > 0.f;
        }
        if (wrong || !scattered[kind]) std::printf("kind %u: %d wrong\n", kind, wrong);
        if (wrong || !scattered[kind]) return 1;
    }
}
