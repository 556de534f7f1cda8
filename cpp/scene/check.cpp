// What the arrays of a scene must not hold. Python checks more, with better words; this keeps the
// native module safe by itself.
#include "scene/scene.h"

namespace veriray {

std::string number(double x) {
    char text[32];
    snprintf(text, sizeof text, "%g", x);
    return text;
}

namespace {

[[noreturn]] void fail(const std::string& name, size_t row, const std::string& rest) {
    throw std::invalid_argument(name + "[" + std::to_string(row) + "] " + rest);
}

template <class T>
void within(const char* name, const Rows<T>& rows, size_t columns, double low, double high) {
    for (size_t i = 0; i < rows.count * columns; ++i) {
        const double x = static_cast<double>(rows.data[i]);
        if (!(x >= low && x <= high))
            fail(name, i / columns,
                 "holds " + number(x) + "; allowed: [" + number(low) + ", " + number(high) + "]");
    }
}

template <class T>
void below(const std::string& name, const Rows<T>& rows, size_t columns, int64_t low, size_t size) {
    for (size_t i = 0; i < rows.count * columns; ++i) {
        const int64_t x = static_cast<int64_t>(rows.data[i]);
        if (x < low || x >= static_cast<int64_t>(size))
            fail(name, i / columns,
                 "holds " + std::to_string(x) + "; there are " + std::to_string(size));
    }
}

template <class T>
void counts(const std::string& name, const Rows<T>& rows, size_t want) {
    if (rows.count != want)
        throw std::invalid_argument(name + " has " + std::to_string(rows.count) +
                                    " rows, expected " + std::to_string(want));
}

}  // namespace

void check_input(const SceneInput& in) {
    constexpr double kLargest = 1e300, kFloat = 3e38;
    if (in.width == 0 || in.height == 0)
        throw std::invalid_argument("the film has no pixels: " + std::to_string(in.width) + " x " +
                                    std::to_string(in.height));
    within("vertices", in.vertices, 3, -kLargest, kLargest);
    within("normals", in.normals, 3, -kLargest, kLargest);
    if (in.normals.count) counts("normals", in.normals, in.vertices.count);
    within("spheres", in.spheres, 4, -kLargest, kLargest);
    for (size_t i = 0; i < in.spheres.count; ++i)
        if (!(in.spheres.data[4 * i + 3] > 0)) fail("spheres", i, "has no radius above 0");
    within("disks", in.disks, 9, -kLargest, kLargest);
    below("triangles", in.triangles, 3, 0, in.vertices.count);
    const size_t rows[3] = {in.triangles.count, in.spheres.count, in.disks.count};
    const size_t materials = in.material_kind.count;
    static const char* const names[3] = {"triangle", "sphere", "disk"};
    for (int g = 0; g < 3; ++g) {
        const std::string name = names[g];
        counts(name + "_material", in.material[g], rows[g]);
        counts(name + "_emission", in.emission[g], rows[g]);
        counts(name + "_boundary", in.boundary[g], rows[g]);
        below(name + "_material", in.material[g], 1, 0, materials);
        below(name + "_emission", in.emission[g], 1, -1, in.emissions.count);
        below(name + "_boundary", in.boundary[g], 1, -1, in.boundaries.count);
    }
    counts("sphere_inward", in.sphere_inward, in.spheres.count);
    below("material_kind", in.material_kind, 1, 0, kMaterialCount);
    for (const auto& [name, colour, most] :
         {std::tuple("reflectance", &in.reflectance, 1.0),
          std::tuple("specular_reflectance", &in.specular_reflectance, 1.0),
          std::tuple("specular_transmittance", &in.specular_transmittance, 1.0),
          std::tuple("eta", &in.eta, 1e6), std::tuple("k", &in.k, 1e6)}) {
        counts(name, *colour, materials);
        within(name, *colour, 3, 0, most);
    }
    for (size_t m = 0; m < materials; ++m)
        if (in.material_kind.data[m] != static_cast<uint32_t>(MaterialKind::kConductor) &&
            !(in.eta.data[3 * m] > 0))
            fail("eta", m, "holds 0; a transparent material needs more");
    counts("opacity", in.opacity, materials);
    within("opacity", in.opacity, 1, 0, 1);
    counts("two_sided", in.two_sided, materials);
    counts("nonlinear", in.nonlinear, materials);
    within("emissions", in.emissions, 3, 0, kFloat);
    within("environment", Rows<float>{in.environment, 1}, 3, 0, kFloat);
    below("boundaries", in.boundaries, 2, -1, in.sigma_t.count);
    counts("albedo", in.albedo, in.sigma_t.count);
    counts("phase_g", in.phase_g, in.sigma_t.count);
    within("sigma_t", in.sigma_t, 3, 0, kFloat);
    within("albedo", in.albedo, 3, 0, 1);
    for (size_t i = 0; i < in.phase_g.count; ++i)
        if (!(in.phase_g.data[i] > -1 && in.phase_g.data[i] < 1))
            fail("phase_g", i, "holds " + number(in.phase_g.data[i]) + "; allowed: (-1, 1)");
    below("light_kind", in.light_kind, 1, 0, 3);
    counts("light_position", in.light_position, in.light_kind.count);
    counts("light_direction", in.light_direction, in.light_kind.count);
    counts("light_angles", in.light_angles, in.light_kind.count);
    counts("light_intensity", in.light_intensity, in.light_kind.count);
    within("light_position", in.light_position, 3, -kLargest, kLargest);
    within("light_direction", in.light_direction, 3, -1.001, 1.001);
    within("light_intensity", in.light_intensity, 3, 0, kFloat);
    for (size_t i = 0; i < in.light_kind.count; ++i) {
        if (in.light_kind.data[i] != 1) continue;
        const double cutoff = in.light_angles.data[2 * i], beam = in.light_angles.data[2 * i + 1];
        if (!(cutoff > 0 && cutoff <= 180 && beam >= 0 && beam <= cutoff))
            fail("light_angles", i,
                 "holds cutoff " + number(cutoff) + " and beam " + number(beam) +
                     "; allowed: 0 <= beam <= cutoff <= 180 degrees");
    }
    if (in.camera_medium < -1 || in.camera_medium >= static_cast<int64_t>(in.sigma_t.count))
        throw std::invalid_argument("the camera's medium " + std::to_string(in.camera_medium) +
                                    " does not exist");
    if (!(in.aperture_radius >= 0 && in.aperture_radius < kLargest) ||
        (in.aperture_radius > 0 && !(in.focus_distance > 0 && in.focus_distance < kLargest)))
        throw std::invalid_argument("aperture_radius = " + number(in.aperture_radius) +
                                    ", focus_distance = " + number(in.focus_distance) +
                                    "; allowed: finite, >= 0 and > 0");
}

}  // namespace veriray
