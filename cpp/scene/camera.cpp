// Camera and pixel filter.
#include <algorithm>

#include "film/shared.h"
#include "scene/bounds.h"

namespace veriray {

void HostScene::set_camera(const SceneInput& in) {
    const double* m = in.to_world;
    const Double3 left{m[0], m[4], m[8]}, up{m[1], m[5], m[9]}, forward{m[2], m[6], m[10]};
    // Film position (u, v) in [0, 1]^2 looks along
    // left tx (1 - 2 (u + px)) + up ty (1 - 2 (v + py)) + forward.
    const Double3 aside = left * (in.tan_half_x * (1 - 2 * in.principal_x)) +
                          up * (in.tan_half_y * (1 - 2 * in.principal_y));
    const Double3 corner = aside + forward;
    const Double3 right = left * (-2 * in.tan_half_x / in.width);
    const Double3 down = up * (-2 * in.tan_half_y / in.height);
    CameraView& c = view.camera;
    // A parallel camera has one direction for all points of the film, and its rays start as those
    // of a camera far away: so it needs no code of its own.
    const double spread = in.parallel ? 0 : 1;
    for (int k = 0; k < 3; ++k) {
        c.corner[k] = static_cast<float>(in.parallel ? forward[k] : corner[k]);
        c.right[k] = static_cast<float>(right[k] * spread);
        c.down[k] = static_cast<float>(down[k] * spread);
        c.forward[k] = static_cast<float>(forward[k]);
        c.eye[k] = before > 0 ? 0.f : static_cast<float>((eye[k] - centre[k]) / unit);
        c.lens_x[k] = static_cast<float>(left[k] * (in.aperture_radius / unit));
        c.lens_y[k] = static_cast<float>(up[k] * (in.aperture_radius / unit));
    }
    c.focus = static_cast<float>(in.focus_distance / unit);
    const double middle = dot(centre - eye, forward);
    if (before > 0) {
        const double depth = middle / unit, size = in.parallel ? 1 / unit : depth;
        const Double3 first = (eye - centre) * (1 / unit) +
                              (in.parallel ? forward * depth + aside * size : corner * depth);
        for (int k = 0; k < 3; ++k) {
            c.plane[0][k] = static_cast<float>(first[k]);
            c.plane[1][k] = static_cast<float>(right[k] * size);
            c.plane[2][k] = static_cast<float>(down[k] * size);
        }
    }
    if (in.aperture_radius > 0) view.features |= kLens;
    // Clipping costs nothing if it cuts nothing: no shape, and no medium around the camera.
    double nearest = INFINITY, farthest = -INFINITY;  // in small scenes
    const auto span = [&](Double3 p, double reach) {
        const double z = dot(p - eye, forward);
        nearest = std::min(nearest, z - reach);
        farthest = std::max(farthest, z + reach);
    };
    if (!bounds_) {
        for (size_t i = 0; i < in.vertices.count; ++i) span(row3(in.vertices, i), 0);
        for (size_t i = 0; i < in.spheres.count; ++i) {
            const double* s = in.spheres.data + 4 * i;
            span({s[0], s[1], s[2]}, s[3]);
        }
        for (size_t i = 0; i < in.disks.count; ++i)
            span(row3(in.disks, 3 * i),
                 ellipse_reach(row3(in.disks, 3 * i + 1), row3(in.disks, 3 * i + 2), forward));
    }
    const auto all_beyond = [&](double depth) {
        return bounds_ ? !bounds_->reaches(in, eye, forward, depth) : nearest > depth;
    };
    const auto all_before = [&](double depth) {
        return bounds_ ? !bounds_->reaches(in, eye, forward * -1, -depth) : farthest < depth;
    };
    double start = in.parallel ? middle - before : 0;  // of rays, if they do not start at the eye
    const bool behind = in.parallel ? start < in.near_clip : in.near_clip > 0 && before == 0;
    bool cuts_near = behind && (in.camera_medium >= 0 || !all_beyond(in.near_clip * (1 + 1e-6)));
    if (in.parallel && cuts_near && middle > in.near_clip) {
        before = middle - (start = in.near_clip);
        cuts_near = false;
    }
    c.before = static_cast<float>(before / unit);
    const bool cuts_far = std::isfinite(in.far_clip) &&
                          (in.camera_medium >= 0 || !all_before(in.far_clip * (1 - 1e-6)));
    c.near_clip = cuts_near ? static_cast<float>((in.near_clip - start) / unit) : 0.f;
    c.far_clip = cuts_far ? static_cast<float>((in.far_clip - start) / unit) : INFINITY;
    if (cuts_near || cuts_far) view.features |= kClip;
}

namespace {
// e^-x for 0 <= x <= 8 in IEEE operations: Taylor of e^-(x/16), fourth power of two squared.
double exp_series(double x) {
    const double y = -x / 16;
    double sum = 1, term = 1;
    for (int k = 1; k < 20; ++k) sum += term *= y / k;
    for (int k = 0; k < 4; ++k) sum *= sum;
    return sum;
}

// sin(pi x) / (pi x) for any x in IEEE operations: Taylor in the distance to the nearest integer.
double sinc(double x) {
    const double turns = std::floor(x + 0.5), y = kPiDouble * (x - turns);
    if (x == 0) return 1;
    double sum = 0, term = y;
    for (int k = 1; k < 24; k += 2) sum += term, term *= -y * y / ((k + 1) * (k + 2));
    return (static_cast<int64_t>(turns) & 1 ? -sum : sum) / (kPiDouble * x);
}

// D. Mitchell, A. Netravali, "Reconstruction Filters in Computer Graphics", SIGGRAPH 1988, eq. 8.
// Coefficients of the powers of the distance, the highest first.
struct Cubics {
    double near[4], far[4];
    Cubics(double b, double c)
        : near{(12 - 9 * b - 6 * c) / 6, (-18 + 12 * b + 6 * c) / 6, 0, (6 - 2 * b) / 6},
          far{(-b - 6 * c) / 6, (6 * b + 30 * c) / 6, (-12 * b - 48 * c) / 6,
              (8 * b + 24 * c) / 6} {}
    double operator()(double z) const {
        const double x = std::abs(z);
        const double* p = x < 1 ? near : far;
        return x < 2 ? ((p[0] * x + p[1]) * x + p[2]) * x + p[3] : 0;
    }
};
}  // namespace

// Edges of cells of equal probability under |density(z)|, |z| < reach, in pixels of size `scale`.
template <class Density>
void HostScene::tabulate_filter(Density density, double reach, double scale) {
    constexpr int kSteps = 1 << 16;
    view.filter.kind = FilterKind::kTable;
    std::vector<double> cdf(kSteps + 1, 0.0);
    for (int i = 0; i < kSteps; ++i)
        cdf[i + 1] = cdf[i] + std::abs(density(-reach + 2 * reach * (i + 0.5) / kSteps));
    int i = 0;
    for (uint32_t e = 0; e <= kFilterTable; ++e) {
        const double want = cdf[kSteps] * e / kFilterTable;
        while (i + 1 < kSteps && (cdf[i + 1] < want || cdf[i + 1] == 0)) ++i;  // 0: of no density
        const double z =
            -reach + 2 * reach * (i + (want - cdf[i]) / (cdf[i + 1] - cdf[i])) / kSteps;
        filter_edges[e] = static_cast<float>(z * scale);
    }
}

// Has samples shared where that leaves less noise than to draw them from the filter, in two
// dimensions; puts the integrals over pixels, of 1 in all and to 1e-7, behind the table. density:
// at a distance of 0 or more in pixels, of any size; 0 from `reach` on. Returns the factor to a
// density of 1; 0 where the filter reaches too far.
template <class Density>
double HostScene::share_filter(FilterForm form, Density density, double reach) {
    constexpr int kSteps = 1 << 11;
    const int rim = static_cast<int>(std::ceil(reach + 0.5)) - 1;
    if (rim > kMostRim) return 0;
    double sum = 0, sizes = 0, squares = 0;
    std::vector<double> parts(2 * rim + 1);
    for (int i = 0; i <= 2 * rim; ++i) {
        for (int k = 0; k < kSteps; ++k) {
            const double x = std::abs(i - rim - 0.5 + (k + 0.5) / kSteps);
            const double y = x < reach ? density(x) / kSteps : 0;
            parts[i] += y, sizes += std::abs(y), squares += y * y * kSteps;
        }
        sum += parts[i];
    }
    if (rim && squares * squares < 0.8 * sizes * sizes * sizes * sizes)
        view.filter.rim = static_cast<uint32_t>(rim);
    std::vector<double> numbers;
    for (double& part : parts) numbers.push_back(part /= sum);
    for (double along_y : parts)
        for (double along_x : parts) numbers.push_back(1 / (1 - along_x * along_y));
    filter_edges.resize(kFilterTable + 1 + numbers.size());
    std::copy(numbers.begin(), numbers.end(), filter_edges.begin() + kFilterTable + 1);
    view.filter.edges = filter_edges.data();
    view.filter.form = form;
    return 1 / sum;
}

namespace {
// The filter that this thread tabulated last: its numbers take milliseconds, and most scenes have
// the same one.
struct KnownFilter {
    std::string name;
    double parameters[2];
    FilterView view;
    Table<float> edges;
};
thread_local KnownFilter known_filter;
}  // namespace

void HostScene::set_filter(const SceneInput& in) {
    KnownFilter& known = known_filter;
    if (known.name != in.filter ||
        !std::equal(known.parameters, known.parameters + 2, std::begin(in.filter_parameters))) {
        known.name.clear();
        make_filter(in);
        known.view = view.filter, known.edges = filter_edges;
        std::copy_n(std::begin(in.filter_parameters), 2, known.parameters);
        known.name = in.filter;
    }
    view.filter = known.view, filter_edges = known.edges;
    view.filter.edges = filter_edges.data();
}

void HostScene::make_filter(const SceneInput& in) {
    FilterView& f = view.filter;
    filter_edges.assign(kFilterTable + 1, 0.f);
    f = {};
    f.kind = FilterKind::kBox, f.radius = 0.5f, f.edges = filter_edges.data();
    f.room = kSharedRoom;
    const double a = in.filter_parameters[0], b = in.filter_parameters[1];
    if (in.filter == "tent") {
        f.kind = FilterKind::kTent;
        f.radius = static_cast<float>(a);
        const double unit = share_filter(FilterForm::kTent, [=](double x) { return 1 - x / a; }, a);
        f.size = static_cast<float>(unit), f.slope = static_cast<float>(unit / a);
    } else if (in.filter == "gaussian") {
        // exp(-x^2 / 2 s^2) - exp(-8) on |x| < 4 s, as Mitsuba's.
        const double end = exp_series(8);
        const auto bell = [=](double z) { return exp_series(z * z / 2) - end; };
        tabulate_filter(bell, 4, a);
        const double unit =
            share_filter(FilterForm::kGaussian, [=](double x) { return bell(x / a); }, 4 * a);
        f.size = static_cast<float>(unit), f.slope = static_cast<float>(1 / (2 * a * a));
        f.end = static_cast<float>(end);
    } else if (in.filter == "mitchell") {
        const Cubics cubics(a, b);
        tabulate_filter(cubics, 2, 1);
        const double unit = share_filter(FilterForm::kCubic, cubics, 2);
        for (int k = 0; k < 4; ++k) {
            f.near[k] = static_cast<float>(cubics.near[k] * unit);
            f.far[k] = static_cast<float>(cubics.far[k] * unit);
        }
    } else if (in.filter == "lanczos") {
        // sinc(x) sinc(x / a) on |x| < a, as Mitsuba's.
        const auto windowed = [=](double x) { return sinc(x) * sinc(x / a); };
        tabulate_filter(windowed, a, 1);
        const double unit = share_filter(FilterForm::kLanczos, windowed, a);
        f.room = kLanczosRoom;
        f.size = static_cast<float>(unit * a / (kPiDouble * kPiDouble)),
        f.slope = static_cast<float>(0.5 / a);
        f.end = static_cast<float>(a);
    } else if (in.filter != "box") {
        throw std::invalid_argument("filter '" + in.filter +
                                    "'; allowed: box, tent, gaussian, mitchell, lanczos");
    }
}

}  // namespace veriray
