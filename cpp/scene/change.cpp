// The form of a scene from that of another one with the same primitives.
#include <algorithm>
#include <cstring>

#include "scene/bounds.h"
#include "scene/sharp.h"
#include "scene/sky_guide.h"

namespace veriray {
namespace {

// What a column changes; kOnAll: the primitives too, or that is not looked into.
constexpr uint32_t kOnSurfaces = 1, kOnMedia = 2, kOnLights = 4, kOnAll = 8;

uint32_t depend_on(const char* name) {
    struct Row {
        const char* column;
        uint32_t stages;
    };
    static constexpr Row kRows[] = {
        {"opacity", kOnSurfaces | kOnMedia},
#define VR_PARAMETER(name, width) {#name, kOnSurfaces},
#include "schema/materials.def"
        {"emissions", kOnSurfaces | kOnLights},
        {"emission_muted", kOnSurfaces | kOnLights},
        {"sigma_t", kOnMedia | kOnLights},
        {"albedo", kOnMedia},
        {"phase_g", kOnMedia},
        {"lobe_share", kOnMedia},
        {"lobe_g", kOnMedia},
        {"lobe_flakes", kOnMedia},
        {"phase_values", kOnMedia},
        {"environment", kOnLights},
        {"sky_compensated", kOnLights},
        {"sky_muted", kOnLights},
        {"muted_segments", kOnLights},
        {"light_muted", kOnLights},
        {"light_position", kOnLights | kOnMedia},
        {"light_direction", kOnLights},
        {"light_intensity", kOnLights},
        {"light_angles", kOnLights},
    };
    for (const Row& row : kRows)
        if (!std::strcmp(row.column, name)) return row.stages;
    return kOnAll;
}

uint32_t changed_stages(const SceneInput& was, const SceneInput& in) {
    uint32_t stages = 0;
#define VR_COLUMN(table, name, ...)    \
    if (!same_rows(was.name, in.name)) \
        stages |= was.name.count == in.name.count ? depend_on(#name) : kOnAll;
#define VR_INDEX VR_COLUMN
#define VR_KIND VR_COLUMN
#include "schema/columns.def"
    return stages;
}

bool shines(const SceneInput& in, size_t emission) {
    const float* e = in.emissions.data + 3 * emission;
    return e[0] > 0 || e[1] > 0 || e[2] > 0;
}

// Whether all materials and emissions are alike in what primitives depend on.
bool alike(const SceneInput& a, const SceneInput& b) {
    for (uint32_t m = 0; m < a.materials_rows(); ++m)
        if (clear_material(a, m) != clear_material(b, m) ||
            has_tangents(a, m) != has_tangents(b, m))
            return false;
    for (size_t e = 0; e < a.emissions.count; ++e)
        if (shines(a, e) != shines(b, e)) return false;
    return true;
}

}  // namespace

// Primitives depend on the frame, which many cameras have in common in a large scene; on materials
// in whether light goes through them, and on emissions in whether they shine. Tables made anew must
// ask for the same features: else later ones might depend on them.
bool HostScene::change(const SceneInput& was, const SceneInput& in, bool rough) {
    uint32_t changed = changed_stages(was, in);
    if (changed & kOnSurfaces && any_sharp(was) != any_sharp(in)) changed |= kOnLights;
    if (!bounds_ || changed & kOnAll || in.camera_medium != was.camera_medium ||
        in.hides_light != was.hides_light)
        return false;
    check_input(in, &was);
    if (changed && !alike(was, in)) return false;
    Frame frame = frame_of(in);
    if (rough && before == 0 && frame.before == 0 &&
        length(frame.eye - centre) + in.aperture_radius <= unit)
        frame.centre = centre, frame.unit = unit;
    if (frame.unit != unit || length(frame.centre - centre) > 0) return false;
    static_cast<Frame&>(*this) = frame;
    width = in.width, height = in.height;
    const auto again = [&](Stage stage) {
        view.features = before_[stage];
        run(stage, in);
        return view.features == before_[stage + 1];
    };
    if (changed & kOnSurfaces && !again(kSurfaceStage)) return false;
    if (changed & kOnMedia && !again(kMediumStage)) return false;
    if (changed & kOnLights) {
        const Table<float> chance = light_chance;
        if (!SkyImage(was).texels != !SkyImage(in).texels) openings_.reset();
        view.lights = {};
        if (!again(kLightStage)) return false;
        if (light_chance.rows() == chance.rows())  // as if one lamp shines more: by primitive
            light_chance = chance, view.light_chance = light_chance.data();
    }
    view.features = before_[kStages];
    view.camera = {};
    set_camera(in);
    set_meter(in);
    if (in.filter != was.filter ||
        !std::equal(std::begin(in.filter_parameters), std::end(in.filter_parameters),
                    std::begin(was.filter_parameters)))
        set_filter(in);
    return true;
}

}  // namespace veriray
