// Tables of surfaces: material, emission, media.
#include <algorithm>
#include <map>
#include <thread>
#include <tuple>

#include "bsdfs/rough_coat.h"
#include "scene/kept.h"
#include "scene/lost_light.h"
#include "scene/scene.h"
#include "scene/thread_pool.h"

namespace veriray {
namespace {

// Reflectance of a smooth interface by the cosine outside.
double smooth_reflectance(double c, double eta) {
    const double s2 = (1 - c * c) / (eta * eta);
    if (s2 >= 1) return 1;
    const double t = std::sqrt(1 - s2);
    const double s = (c - eta * t) / (c + eta * t), p = (eta * c - t) / (eta * c + t);
    return 0.5 * (s * s + p * p);
}

// Hemispherical reflectance of a smooth interface for diffuse light from inside. F_e is the
// integral of F(c) 2c dc over cosines c outside (midpoint rule in c^2, error below 1e-6), and the
// inside follows from detailed balance: 1 - F_i = (1 - F_e) / eta^2.
double diffuse_reflectance_inside(double eta) {
    if (eta == 1) return 0;
    constexpr int kSteps = 1 << 14;
    double sum = 0;
    for (int i = 0; i < kSteps; ++i) sum += smooth_reflectance(std::sqrt((i + 0.5) / kSteps), eta);
    return 1 - (1 - sum / kSteps) / (eta * eta);
}

// What a rough coat lets in from outside, by cosine, and the share of diffuse light from inside
// that it sends back, as Mitsuba 3.9 has them: the latter is a mean over the cosines of the table,
// which counts its ends in full (for alpha 0.1 and the default index 1.5 % below the integral). For
// a cosine of 0, where Mitsuba takes 1e-6, the limit. smooth: what a smooth coat lets in; linear
// between the cosines, that is at most 1.4e-3 low, and 5e-5 on the average (indices up to 2).
struct CoatTable {
    float transmittance[kCoatCells + 1];
    double inside;
};
CoatTable rough_coat(float eta, float alpha, bool ggx, bool correlated, bool smooth) {
    CoatTable coat;
    double sent[kCoatCells + 1] = {};
    parallel(
        smooth ? 1u : std::max(1u, std::thread::hardware_concurrency()), kCoatCells + 1, {},
        [&](uint32_t, uint64_t k) {
            const double place = static_cast<double>(k) / kCoatCells;
            const float cosine = static_cast<float>(k) / kCoatCells;
            coat.transmittance[k] =
                static_cast<float>(smooth ? 1 - smooth_reflectance(place, double{eta})
                                          : rough_share(true, cosine, eta, alpha, ggx, correlated));
            if (!smooth)
                sent[k] = 2 * place * rough_share(false, cosine, 1 / eta, alpha, ggx, correlated);
        });
    double sum = 0;
    for (const double one : sent) sum += one;
    coat.inside = sum / (kCoatCells + 1);
    return coat;
}

// make(arguments...), made once for all scenes; one store per signature.
template <class Value, class... Arguments>
Value once_for(Value make(Arguments...), Arguments... arguments) {
    constexpr size_t kMost = 4096;  // a few kB each
    using Key = std::tuple<Value (*)(Arguments...), Arguments...>;
    static auto& kept = *new Kept<Key, Value>(kMost);  // threads may outlive static objects
    return kept(Key{make, arguments...}, [&] { return make(arguments...); });
}

}  // namespace

// One row per primitive without a tree, else one per (material, emission, boundary).
void HostScene::list_surfaces(const SceneInput& in) {
    const bool tree = (view.features & kBvh) != 0;
    std::vector<SurfaceKey> rows;
    std::map<SurfaceKey, uint32_t> known;
    const auto key_of = [&](size_t i) {
        return SurfaceKey{sources[i].material, sources[i].emission, sources[i].boundary};
    };
    if (tree) {
        // Runs of primitives of one surface.
        const std::vector<uint32_t> starts = where(sources.size(), [&](size_t i) {
            return i == 0 || !sources[i].same_surface(sources[i - 1]);
        });
        std::vector<uint32_t> row(starts.size());
        for (size_t k = 0; k < starts.size(); ++k) {
            const SurfaceKey key = key_of(starts[k]);
            const auto [at, fresh] = known.try_emplace(key, static_cast<uint32_t>(rows.size()));
            row[k] = at->second;
            if (fresh) rows.push_back(key);
        }
        surface_of.resize(sources.size());
        in_chunks(kAllThreads, sources.size(), [&](size_t first, size_t last) {
            size_t k = static_cast<size_t>(std::upper_bound(starts.begin(), starts.end(), first) -
                                           starts.begin());
            for (size_t i = first; i < last; ++i) {
                k += k < starts.size() && starts[k] == i;
                surface_of[i] = row[k - 1];
            }
        });
    } else {
        for (size_t i = 0; i < sources.size(); ++i) rows.push_back(key_of(i));
    }
    // Of blends, the rows of their other materials come last, in the order of the blends.
    for (size_t r = 0; r < rows.size(); ++r) {
        SurfaceKey key = rows[r];
        const int32_t other = in.blend_material.data[std::get<0>(key)];
        if (other < 0) continue;
        std::get<0>(key) = static_cast<uint32_t>(other);
        rows.push_back(key);
    }
    surface_keys_.assign(rows.begin(), rows.end());
}

void HostScene::set_surfaces(const SceneInput& in) {
    const Table<SurfaceKey>& rows = surface_keys_;
    std::vector<uint32_t> others(rows.size(), ~0u);
    size_t blends = 0;
    for (const SurfaceKey& key : rows.rows())
        blends += in.blend_material.data[std::get<0>(key)] >= 0;
    for (size_t r = 0, other = rows.size() - blends; other < rows.size(); ++r)
        if (in.blend_material.data[std::get<0>(rows[r])] >= 0)
            others[r] = static_cast<uint32_t>(other++), view.features |= kBlend;
    view.surface_count = static_cast<uint32_t>(rows.size());
    view.surface_stride = padded(rows.size());
    size_t columns = 0;
    for (const SurfaceKey& row : rows.rows())
        columns = std::max(columns,
                           size_t{closure_traits(in.material_kind.data[std::get<0>(row)]).table});
    surfaces.assign((kSurfaceColumns + columns) * view.surface_stride, 0.f);
    for (size_t r = 0; r < rows.size(); ++r) {
        const auto [m, emission, boundary] = rows[r];
        const auto put = [&](uint32_t c, float x) {
            surfaces[static_cast<size_t>(c) * view.surface_stride + r] = x;
        };
        const uint32_t kind = in.material_kind.data[m];
        const ClosureTraits& closure = closure_traits(kind);
#define VR_PARAMETER(name, width)        \
    for (uint32_t k = 0; k < width; ++k) \
        put(kSurface_##name + k,         \
            static_cast<float>(in.name.data[static_cast<size_t>(width) * m + k]));
#include "schema/materials.def"
        const bool ggx = in.distribution.data[m] != 0, correlated = in.shadowing.data[m] != 0;
        put(kSurface_distribution, slopes_number(ggx, correlated));
        uint32_t given = 0;
#define VR_TEXTURABLE(name)                                                        \
    put(kSurface_##name##_texture, static_cast<float>(in.name##_texture.data[m])); \
    if (in.name##_texture.data[m] >= 0) given |= 1u << kTexturable_##name;
#include "schema/materials.def"
        put(kSurfaceTextured, bit_cast<float>(given));
        if (given) view.features |= kTextures;
        if (kCoatedKinds >> kind & 1u) {
            const double eta = static_cast<double>(in.eta.data[3 * m]);
            const bool once = in.k.data[3 * m] > 0;
            double inside;
            if (closure.table) {
                const float index = in.eta.data[3 * m], alpha = in.alpha_u.data[m];
                const CoatTable coat = once_for(rough_coat, index, alpha, ggx, correlated, once);
                for (uint32_t k = 0; k <= kCoatCells; ++k)
                    put(kSurfaceColumns + k, coat.transmittance[k]);
                inside = coat.inside;
            } else {
                inside = once_for(diffuse_reflectance_inside, eta);
            }
            if (once) inside = 0;
            const double squared = once ? 1 : eta * eta;
            if (in.reflectance_texture.data[m] >= 0) {  // the rest follows at the hit: base_in_coat
                put(kSurface_reflectance, static_cast<float>(inside));
                put(kSurface_reflectance + 1, in.nonlinear.data[m] ? 1.f : 0.f);
                put(kSurface_reflectance + 2, static_cast<float>(1 / squared));
            }
            for (uint32_t k = 0; k < 3 && in.reflectance_texture.data[m] < 0; ++k) {
                const double rho = static_cast<double>(in.reflectance.data[3 * m + k]);
                put(kSurface_reflectance + k,
                    static_cast<float>(rho / (1 - (in.nonlinear.data[m] ? rho : 1) * inside) /
                                       squared));
            }
        }
        if (kWholeKinds >> kind & 1u) {
            const auto put_own = [&](uint32_t c, double x) {
                put(kSurfaceColumns + c, static_cast<float>(x));
            };
            // The light lost at each cosine for one side; returns its mean.
            const auto put_lost = [&, m = m](uint32_t first, double eta) {  // as Clang 14 wants it
                const LostLightTable table =
                    once_for(lost_light, double{in.alpha_u.data[m]}, ggx, correlated, eta);
                for (uint32_t k = 0; k <= kLostCells; ++k)
                    put_own(first + k, double{table.at_cosine[k]});
                return table.mean;
            };
            const float *eta = in.eta.data + 3 * m, *absorbed = in.k.data + 3 * m;
            if (kMetalKinds >> kind & 1u) {
                put_own(kLostMean, put_lost(kLostAtCosine, 0));
                for (uint32_t k = 0; k < 3; ++k)
                    put_own(kReflectedMean + k,
                            mean_reflectance(double{eta[k]}, double{absorbed[k]}));
            } else {
                // f is reciprocal if the shares that cross are in proportion to the squared index
                // of the side they go to, times the mean lost there: the largest such that are at
                // most what a smooth interface lets through.
                const double front = put_lost(kLostAtCosine, double{eta[0]});
                const double behind = put_lost(kLostBehind, 1 / double{eta[0]});
                const double enters = 1 - mean_reflectance(double{eta[0]});
                const double leaves = enters / (double{eta[0]} * double{eta[0]});
                put_own(kLostMean, front);
                put_own(kThrough, enters * std::min(1., behind / front));
                put_own(kLostMeanBehind, behind);
                put_own(kThroughBehind, leaves * std::min(1., front / behind));
            }
        }
        if (has_tangents(in, m)) view.features |= kTangents;
        if (in.relief_texture.data[m] >= 0) view.features |= kSmooth;
        put(kSurface_relief_scale, static_cast<float>(in.relief_scale.data[m] / unit));
        put(kSurfaceRelief, static_cast<float>(in.relief_texture.data[m]));
        put(kSurfaceReliefTraits,
            static_cast<float>(only_if(in.relief_heights.data[m], kReliefHeights) |
                               only_if(in.relief_flips.data[m], kReliefFlips) |
                               only_if(in.relief_shades.data[m], kReliefShades) |
                               only_if(in.relief_mirrored.data[m], kReliefMirrored)));
        for (uint32_t k = 0; k < 3 && emission >= 0; ++k)
            if (!in.emission_muted.data[emission])
                put(kSurfaceRadiance + k, in.emissions.data[3 * emission + k]);
        const int32_t image = emission >= 0 ? in.emission_texture.data[emission] : -1;
        put(kSurfaceRadianceTexture, static_cast<float>(image));
        if (image >= 0) view.features |= kTextures | kLightTextures;
        const bool both = in.two_sided.data[m] || closure.lets_through();
        put(kSurfaceTwoSided, both ? (in.blend_sides.data[m] ? 2.f : 1.f) : 0.f);
        put(kSurfaceKind, static_cast<float>(kind));
        const int32_t* border = boundary >= 0 ? in.boundaries.data + 2 * boundary : nullptr;
        put(kSurfaceInside, border ? static_cast<float>(border[0] + 1) : -1.f);
        put(kSurfaceOutside, border ? static_cast<float>(border[1] + 1) : -1.f);
        put(kSurfaceOther, bit_cast<float>(others[r]));

        view.features |= materials(1u << kind) | only_if(closure.refracts, kRefraction) |
                         only_if(closure.passes || covers_partly(in, m), kPass);
    }
    view.surface_of = view.features & kBvh ? surface_of.data() : nullptr;
    view.surfaces = surfaces.data();
}

}  // namespace veriray
