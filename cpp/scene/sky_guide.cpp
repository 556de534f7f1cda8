// Finds from where the sky is seen through openings: rays through a grid of cubes, of which those
// are blocked that an opaque surface meets. What the grid does not resolve changes noise
// only, as every patch of the sky keeps a chance.
#include "scene/sky_guide.h"

#include <algorithm>
#include <cmath>

#include "core/math.h"
#include "scene/bounds.h"
#include "scene/cubes.h"
#include "scene/intervals.h"
#include "scene/kept.h"
#include "scene/thread_pool.h"

namespace veriray {
namespace {

// Cubes along a place, points in it.
constexpr uint32_t kPlaceCubes = 6, kPoints = 4;
// A few primitives are apart if they are so many times as large as all others together, as a ground
// or a planet may be.
constexpr double kApart = 8;
constexpr size_t kMostApart = 4;
// Points beside surfaces that see less of the sky's power than this are in a room; so many of them
// make a scene of rooms. A rougher look comes first: one of so many places (a number that has no
// divisor in common with those along an axis) and patches. kLeastShare: that the choice among
// lights takes a point to see.
constexpr double kLittle = 0.0625, kMany = 0.125, kLeastShare = 0x1p-8;
constexpr uint32_t kRoughPlaces = 13, kRoughPatches = 2;
// Of the sky, below which openings are not told apart; of one of one colour, texels.
constexpr uint32_t kFewestPatches = 64, kEvenColumns = 64, kEvenRows = 33;
// Share of the samples that do not follow what is seen, and of a place's whose patches are seen.
constexpr double kUnguided = 0.125, kBeside = 0.125;

// Around all but what is apart; without size where there is nothing.
Box enclosed(std::vector<Box> boxes) {
    const auto size = [](const Box& box) { return length(box.high - box.low); };
    std::erase_if(boxes, [&](const Box& box) { return !(size(box) > 0 && size(box) < INFINITY); });
    if (boxes.empty()) return {};
    std::sort(boxes.begin(), boxes.end(),
              [&](const Box& a, const Box& b) { return size(a) < size(b); });
    const size_t least = boxes.size() - std::min(boxes.size() - 1, kMostApart);
    Box all = boxes.front();
    for (size_t k = 1; k < boxes.size(); ++k) {
        if (k >= least && size(boxes[k]) > kApart * size(all)) break;
        all = around(all, boxes[k]);
    }
    return all;
}

// Around each primitive, or in a large scene around runs of them that have nothing apart.
std::vector<Box> boxes_of(const SceneInput& in, const SceneBounds* bounds) {
    std::vector<Box> boxes;
    const auto add = [&](size_t first, size_t last) {
        for (size_t i = first; i < last; ++i) boxes.push_back(box_around(in, i));
    };
    if (!bounds) {
        add(0, in.primitives());
        return boxes;
    }
    const std::vector<Box>& runs = bounds->runs();
    const Box all = enclosed(runs);
    for (size_t r = 0; r < runs.size(); ++r) {
        const Box both = around(runs[r], all);
        if (length(both.low - all.low) > 0 || length(both.high - all.high) > 0)
            add(r * SceneBounds::kRun, std::min(in.primitives(), (r + 1) * SceneBounds::kRun));
        else
            boxes.push_back(runs[r]);
    }
    return boxes;
}

void block_all(const SceneInput& in, Cubes& cubes) {
    std::vector<uint8_t> clear(in.materials_rows());
    for (uint32_t m = 0; m < clear.size(); ++m) clear[m] = clear_material(in, m);
    const auto opaque = [&](ShapeGroup group, size_t row) {
        return !clear[in.material(group).data[row]];
    };
    in_chunks(kAllThreads, in.triangles.count, [&](size_t first, size_t last) {
        for (size_t i = first; i < last; ++i) {
            const auto corner = [&](size_t k) {
                return row3(in.vertices, in.triangles.data[3 * i + k]);
            };
            if (opaque(kTriangleGroup, i)) cubes.block_triangle(corner(0), corner(1), corner(2));
        }
    });
    in_chunks(kAllThreads, in.spheres.count, [&](size_t first, size_t last) {
        for (size_t i = first; i < last; ++i) {
            const double* s = in.spheres.data + 4 * i;
            if (opaque(kSphereGroup, i)) cubes.block_sphere({s[0], s[1], s[2]}, s[3]);
        }
    });
    for (size_t i = 0; i < in.disks.count; ++i) {
        if (!opaque(kDiskGroup, i)) continue;
        const Double3 c = row3(in.disks, 3 * i), a = row3(in.disks, 3 * i + 1),
                      b = row3(in.disks, 3 * i + 2);
        constexpr int kSides = 16;
        const auto rim = [&](int k) {
            float sine, cosine;
            sincos_2pi(static_cast<float>(k % kSides) / kSides, sine, cosine);
            return c + a * double{cosine} + b * double{sine};
        };
        for (int k = 0; k < kSides; ++k) cubes.block_triangle(c, rim(k), rim(k + 1));
    }
}

// Numbers in [0, 1) that fill it evenly. M. Roberts, "The Unreasonable Effectiveness of
// Quasirandom Sequences", 2018.
double even(uint64_t k, double step) {
    const double x = static_cast<double>(k) * step;
    return x - std::floor(x);
}

// The world's direction of a place in the map of cells.
Double3 sky_direction(const SkyPatches& p, const Double3 (&axes)[3], double column, double row) {
    const double turn = (column + 0.5) / p.cell_columns;
    float sine, cosine, right, along;
    sincos_2pi(static_cast<float>(row / (2 * p.cell_rows)), sine, cosine);
    sincos_2pi(static_cast<float>(turn < 1 ? turn : turn - 1), right, along);
    return axes[0] * double{sine * right} + axes[1] * double{cosine} +
           axes[2] * -double{sine * along};
}

// By patch, its power (the same for all skies of one colour) and kPoints directions drawn in
// proportion to it.
struct PatchLight {
    std::vector<double> power;
    std::vector<Way> ways;

    PatchLight(const SkyImage& sky, const SkyPatches& patches)
        : power(patches.count()), ways(size_t{kPoints} * patches.count(), Way({0, 0, 1})) {
        std::vector<double> sine(patches.cell_rows);  // of the polar angle, by row
        for (uint32_t j = 0; j < patches.cell_rows; ++j) {
            float of_middle, cosine;
            sincos_2pi((static_cast<float>(j) + 0.5f) / static_cast<float>(2 * patches.cell_rows),
                       of_middle, cosine);
            sine[j] = double{of_middle};
        }
        parallel(sky.threads(), patches.count(), {},
                 [&](uint32_t, uint64_t p) { aim(sky, patches, sine, static_cast<uint32_t>(p)); });
    }

   private:
    void aim(const SkyImage& sky, const SkyPatches& patches, const std::vector<double>& sine,
             uint32_t patch) {
        const uint32_t r = patch / patches.columns, c = patch % patches.columns;
        const auto each = [&](auto visit) {
            for (uint32_t j = patches.first_row(r); j < patches.first_row(r + 1); ++j)
                for (uint32_t i = patches.first_column(c); i < patches.first_column(c + 1); ++i)
                    visit(i, j, (sky.even() ? 1 : sky.light(i, j)) * sine[j]);
        };
        double all = 0, sum = 0;
        each([&](uint32_t, uint32_t, double light) { all += light; });
        power[patch] = all;
        uint32_t k = 0;
        const double first = even(patch, 0.6180339887498949);
        each([&](uint32_t i, uint32_t j, double light) {
            sum += light;
            for (; k < kPoints && sum * kPoints > (k + first) * all; ++k)
                ways[patch * kPoints + k] = Way(sky_direction(patches, sky.axes, i + 0.5, j + 0.5));
        });
    }
};

// A look around from points of places.
class Look {
   public:
    Look(const SceneInput& in, const SkyPatches& patches, const PatchLight& light, const Box& box)
        : patches_(patches), light_(light), cubes_(box) {
        block_all(in, cubes_);
        cubes_.open_outside();
        for (int k = 0; k < 3; ++k)
            along[k] = (static_cast<uint32_t>(cubes_.along(k)) + kPlaceCubes - 1) / kPlaceCubes;
        places = size_t{along[0]} * along[1] * along[2];
        seen.resize(places), shares.resize(places);
    }

    // From `count` points of a place to every `each`th patch.
    void around_place(size_t place, uint32_t count, uint32_t each) {
        bool beside;
        const std::vector<std::array<int, 3>> open = open_cubes(place, beside);
        const size_t n = std::min<size_t>(count, open.size());
        seen[place].clear(), shares[place].clear();
        for (size_t k = 0; k < n; ++k) {
            const std::array<int, 3>& cube = open[(2 * k + 1) * open.size() / (2 * n)];
            const uint64_t number = place * kPoints + k;
            const auto within = [&](double step) { return static_cast<float>(even(number, step)); };
            const std::array<float, 3> at{within(0.8191725133961645), within(0.6710436067037893),
                                          within(0.5497004779019703)};
            SkyOpenings::Seen met;
            double sum = 0, asked = 0;
            for (uint32_t p = number % each; p < patches_.count(); p += each) {
                asked += light_.power[p];
                if (light_.power[p] > 0 && cubes_.leaves(cube, at, light_.ways[p * kPoints + k]))
                    met.set(p), sum += light_.power[p];
            }
            seen[place].push_back(met);
            if (beside && asked > 0) shares[place].push_back(sum / asked);
        }
    }
    // Whether many of the points beside surfaces see little; share: what they see.
    bool in_rooms(double& share) const {
        size_t points = 0, little = 0;
        share = 0;
        for (const auto& of_place : shares)
            for (const double s : of_place) ++points, little += s < kLittle, share += s;
        share = std::max(share / static_cast<double>(std::max<size_t>(points, 1)), kLeastShare);
        return static_cast<double>(little) > kMany * static_cast<double>(points);
    }
    Double3 low() const { return cubes_.low(); }
    double place_edge() const { return kPlaceCubes * cubes_.edge(); }

    uint32_t along[3];
    size_t places;
    std::vector<std::vector<SkyOpenings::Seen>> seen;
    std::vector<std::vector<double>> shares;  // of the sky's power, by point beside surfaces

   private:
    // The open ones of a place, without the outermost; if there are any, those beside what is
    // blocked.
    std::vector<std::array<int, 3>> open_cubes(size_t place, bool& beside) const {
        int from[3], to[3];
        for (int k = 0; k < 3; ++k) {
            const int first = static_cast<int>(place % along[k] * kPlaceCubes);
            place /= along[k];
            from[k] = std::max(first, 1);
            to[k] = std::min(first + static_cast<int>(kPlaceCubes), cubes_.along(k) - 1);
        }
        std::vector<std::array<int, 3>> open, near;
        for (int z = from[2]; z < to[2]; ++z)
            for (int y = from[1]; y < to[1]; ++y)
                for (int x = from[0]; x < to[0]; ++x) {
                    if (!cubes_.open(x, y, z)) continue;
                    open.push_back({x, y, z});
                    if (cubes_.blocked(x - 1, y, z) || cubes_.blocked(x + 1, y, z) ||
                        cubes_.blocked(x, y - 1, z) || cubes_.blocked(x, y + 1, z) ||
                        cubes_.blocked(x, y, z - 1) || cubes_.blocked(x, y, z + 1))
                        near.push_back({x, y, z});
                }
        beside = !near.empty();
        return beside ? near : open;
    }

    const SkyPatches& patches_;
    const PatchLight& light_;
    Cubes cubes_;
};

SkyOpenings look_around(const SceneInput& in, const SkyPatches& patches, const PatchLight& light,
                        const Box& box) {
    SkyOpenings o;
    Look look(in, patches, light, box);
    const uint32_t threads = std::max(1u, std::thread::hardware_concurrency());
    parallel(threads, (look.places + kRoughPlaces - 1) / kRoughPlaces, {},
             [&](uint32_t, uint64_t k) { look.around_place(k * kRoughPlaces, 1, kRoughPatches); });
    if (!look.in_rooms(o.share)) return SkyOpenings{};
    parallel(threads, look.places, {},
             [&](uint32_t, uint64_t k) { look.around_place(k, kPoints, 1); });
    if (!look.in_rooms(o.share)) return SkyOpenings{};
    o.low = look.low(), o.place = look.place_edge();
    std::copy_n(look.along, 3, o.along);
    o.first.push_back(0);
    for (const auto& of_place : look.seen) {
        o.seen.insert(o.seen.end(), of_place.begin(), of_place.end());
        o.first.push_back(static_cast<uint32_t>(o.seen.size()));
    }
    return o;
}

// All that openings depend on, of a small scene: it is made anew for each camera. Empty: of others.
std::vector<double> key_of(const SceneInput& in, const Box& box, const PatchLight& light) {
    if (in.primitives() > kMostSmall) return {};
    std::vector<double> key{box.low.x,
                            box.low.y,
                            box.low.z,
                            double(in.triangles.count),
                            double(in.spheres.count),
                            double(in.disks.count)};
    const auto put = [&](ShapeGroup group, size_t row) {
        key.push_back(clear_material(in, in.material(group).data[row]));
    };
    for (size_t i = 0; i < in.triangles.count; ++i) {
        put(kTriangleGroup, i);
        for (size_t k = 0; k < 3; ++k) {
            const Double3 p = row3(in.vertices, in.triangles.data[3 * i + k]);
            key.insert(key.end(), {p.x, p.y, p.z});
        }
    }
    for (size_t i = 0; i < in.spheres.count; ++i) put(kSphereGroup, i);
    key.insert(key.end(), in.spheres.data, in.spheres.data + 4 * in.spheres.count);
    for (size_t i = 0; i < in.disks.count; ++i) put(kDiskGroup, i);
    key.insert(key.end(), in.disks.data, in.disks.data + 9 * in.disks.count);
    key.insert(key.end(), light.power.begin(), light.power.end());
    for (const Way& way : light.ways) {
        key.insert(key.end(), way.step.begin(), way.step.end());
        key.insert(key.end(), way.each.begin(), way.each.end());
    }
    return key;
}

uint32_t patch_bits(uint32_t cells, uint32_t most) {
    uint32_t bits = 0;
    while ((cells + (1u << bits) - 1) >> bits > most) ++bits;
    return bits;
}

}  // namespace

SkyPatches::SkyPatches(uint32_t down, uint32_t across)
    : cell_rows(down),
      cell_columns(across),
      row_bits(patch_bits(down, kMostRows)),
      column_bits(patch_bits(across, kMostColumns)),
      rows((down + (1u << row_bits) - 1) >> row_bits),
      columns((across + (1u << column_bits) - 1) >> column_bits) {}

SkyImage::SkyImage(const SceneInput& in)
    : texels(in.sky_texels.data), width(in.sky_size.data[0]), rows(in.sky_size.data[1]) {
    const double* m = in.sky_to_world.data;
    for (int k = 0; k < 3; ++k) axes[k] = {m[k], m[3 + k], m[6 + k]};
    if (in.sky_texels.count) return;
    texels = nullptr;
    const float* e = in.environment.data;
    if (!(e[0] > 0 || e[1] > 0 || e[2] > 0)) return;
    width = kEvenColumns, rows = kEvenRows;
    for (uint32_t k = 0; k < 3 * width * rows; ++k) even_.push_back(in.environment.data[k % 3]);
    texels = even_.data();
    for (int k = 0; k < 3; ++k) axes[k] = {double(k == 0), double(k == 1), double(k == 2)};
}

SkyOpenings sky_openings(const SceneInput& in, const SkyImage& sky, const SceneBounds* bounds) {
    if (!sky.texels) return {};
    const SkyPatches patches(sky.cell_rows(), sky.width);
    const Box box = enclosed(boxes_of(in, bounds));
    if (patches.count() < kFewestPatches || !(length(box.high - box.low) > 0)) return {};
    const PatchLight light(sky, patches);
    if (!(*std::max_element(light.power.begin(), light.power.end()) > 0)) return {};
    const auto make = [&] { return look_around(in, patches, light, box); };
    // threads may outlive static objects
    static auto& kept = *new Kept<std::vector<double>, SkyOpenings>(1);
    const std::vector<double> key = key_of(in, box, light);
    return key.empty() ? make() : kept(key, make);
}

std::vector<double> guided_weights(const SkyOpenings& o, const SkyPatches& patches, size_t place,
                                   const std::vector<double>& weight) {
    if (place >= o.places()) return weight;
    double all = 0;
    for (const double w : weight) all += w;
    // How much a patch is seen, by points of the place and of those beside it.
    std::vector<double> seen(weight.size());
    const auto add = [&](size_t from, double say) {
        for (uint32_t k = o.first[from]; k < o.first[from + 1]; ++k) {
            double sum = 0;
            for (size_t p = 0; p < weight.size(); ++p) sum += o.seen[k][p] ? weight[p] : 0;
            if (!(sum > 0)) continue;
            const double share = std::sqrt(sum / all);
            for (size_t p = 0; p < weight.size(); ++p)
                if (o.seen[k][p]) seen[p] += say / (share * std::sqrt(share));
        }
    };
    add(place, 1);
    size_t stride = 1;
    for (const uint32_t n : o.along) {
        const size_t at = place / stride % n;
        if (at > 0) add(place - stride, kBeside);
        if (at + 1 < n) add(place + stride, kBeside);
        stride *= n;
    }
    std::vector<double> result(weight.size());
    double total = 0;
    for (uint32_t r = 0; r < patches.rows; ++r)
        for (uint32_t c = 0; c < patches.columns; ++c) {
            double near = 0;
            for (uint32_t a = r ? r - 1 : 0; a < std::min(r + 2, patches.rows); ++a)
                for (uint32_t b = 0; b < 3; ++b)
                    near +=
                        seen[a * patches.columns + (c + patches.columns + b - 1) % patches.columns];
            const size_t p = r * patches.columns + c;
            result[p] = near * weight[p];
            total += result[p];
        }
    if (!(total > 0)) return weight;
    for (size_t p = 0; p < weight.size(); ++p)
        result[p] = result[p] * ((1 - kUnguided) / total) + weight[p] * (kUnguided / all);
    return result;
}

// lines: the light by row of cells and, in it, by patch.
void HostScene::set_sky_guide(const SkyPatches& patches, const SkyOpenings& openings,
                              const std::vector<double>& lines) {
    const size_t stride = size_t{patches.rows} * (1 + patches.columns),
                 tall = size_t{1} << patches.row_bits;
    sky_rows.resize(patches.count() * tall);
    std::vector<double> weight(patches.count());
    for (uint32_t r = 0; r < patches.rows; ++r)
        for (uint32_t c = 0; c < patches.columns; ++c) {
            const uint32_t p = r * patches.columns + c;
            std::vector<double> sums(tall);
            for (uint32_t k = 0; k < tall; ++k) {
                const uint32_t j = patches.first_row(r) + k;
                if (j < patches.first_row(r + 1))
                    weight[p] += lines[size_t{j} * patches.columns + c];
                sums[k] = weight[p];
            }
            put_ends(sums, &sky_rows[p * tall]);
        }
    sky_places.resize((openings.places() + 1) * stride);
    parallel(std::max(1u, std::thread::hardware_concurrency()), openings.places() + 1, {},
             [&](uint32_t, uint64_t place) {
                 const std::vector<double> w = guided_weights(openings, patches, place, weight);
                 float* out = &sky_places[place * stride];
                 std::vector<double> rows(patches.rows), row(patches.columns);
                 double all = 0;
                 for (uint32_t r = 0; r < patches.rows; ++r) {
                     double sum = 0;
                     for (uint32_t c = 0; c < patches.columns; ++c)
                         row[c] = sum += w[r * patches.columns + c];
                     rows[r] = all += sum;
                     put_ends(row, out + patches.rows + r * patches.columns);
                 }
                 put_ends(rows, out);
             });
    SkyGuide& g = view.lights.map.guide;
    g.places = sky_places.data(), g.rows = sky_rows.data();
    for (int k = 0; k < 3; ++k) {
        g.low[k] = static_cast<float>((openings.low[k] - centre[k]) / unit);
        g.per_length[k] = static_cast<float>(unit / openings.place);
        g.along[k] = openings.along[k];
    }
    g.patch_rows = patches.rows, g.patch_columns = patches.columns;
    g.row_bits = patches.row_bits, g.column_bits = patches.column_bits;
}

}  // namespace veriray
