// The table of phase functions' lobes.
#include <cmath>

#include "scene/intervals.h"
#include "scene/scene.h"

namespace veriray {
namespace {

// S = M M^T by A. Cholesky: M by rows, its inverse, and 1 / (4 pi det(M)).
void put_flakes(const double* s, float* out, size_t stride) {
    const double a = std::sqrt(s[0]), b = s[3] / a, d = s[4] / a;
    const double c = std::sqrt(s[1] - b * b), e = (s[5] - b * d) / c;
    const double f = std::sqrt(s[2] - d * d - e * e);
    const double values[kFlakeFloats] = {a,
                                         b,
                                         c,
                                         d,
                                         e,
                                         f,
                                         1 / a,
                                         -b / (a * c),
                                         1 / c,
                                         (b * e - c * d) / (a * c * f),
                                         -e / (c * f),
                                         1 / f,
                                         1 / (4 * kPiDouble * (a * c * f))};
    for (uint32_t k = 0; k < kFlakeFloats; ++k) out[k * stride] = static_cast<float>(values[k]);
}

}  // namespace

// Each medium gets its lobes one after another: those of Henyey and Greenstein alone one of their
// own, so that stages look at one table.
void HostScene::set_phases(const SceneInput& in) {
    if (!(view.features & kPhases)) return;
    const size_t given = in.sigma_t.count;
    struct Lobe {
        uint32_t kind, row;
        double share, g;
    };
    std::vector<Lobe> all;
    std::vector<double> sums;
    PhaseView& phases = view.phases;
    phases = {};
    const auto medium_column = [&](MediumColumn c, size_t m) -> float& {
        return media[static_cast<size_t>(c) * view.medium_stride + m];
    };
    size_t most_cells = 1, values = 0;
    medium_column(kMediumFlakes, 0) = -1;
    for (size_t m = 1; m <= given; ++m) {
        const int32_t first = in.phase_lobe.data[m - 1];
        const uint32_t count = first < 0 ? 1 : in.phase_lobes.data[m - 1];
        medium_column(kMediumLobe, m) = static_cast<float>(all.size());
        medium_column(kMediumLobes, m) = static_cast<float>(count);
        const bool facets =
            first >= 0 && count == 1 && in.lobe_kind.data[static_cast<uint32_t>(first)] == kFlakes;
        medium_column(kMediumFlakes, m) = facets ? static_cast<float>(all.size()) : -1.f;
        phases.most = std::max(phases.most, count);
        if (first < 0) {
            all.push_back({kHenyeyGreenstein, 0, 1, static_cast<double>(in.phase_g.data[m - 1])});
            continue;
        }
        double total = 0;
        for (uint32_t k = 0; k < count; ++k)
            total += static_cast<double>(in.lobe_share.data[static_cast<uint32_t>(first) + k]);
        for (uint32_t k = 0; k < count; ++k) {
            const uint32_t row = static_cast<uint32_t>(first) + k;
            all.push_back({in.lobe_kind.data[row], row,
                           static_cast<double>(in.lobe_share.data[row]) / total,
                           static_cast<double>(in.lobe_g.data[row])});
            if (all.back().kind == kFlakes) phases.flakes = 1;
            if (all.back().kind != kTabulated) continue;
            most_cells = std::max<size_t>(most_cells, in.lobe_size.data[row] - 1);
            values += in.lobe_size.data[row];
        }
    }
    phases.count = static_cast<uint32_t>(all.size());
    phases.stride = padded(all.size());
    phases.bits = guide_bits(static_cast<uint32_t>(most_cells));
    const size_t guide = (size_t{1} << phases.bits) + 1;
    lobes.assign(size_t{kLobeColumns} * phases.stride, 0.f);
    phase_values.assign(values, 0.f), phase_drawn.assign(values, 0.f);
    phase_ends.assign(all.size() + values, 0.f);
    std::vector<uint32_t> guides(2 * (given + 1), 0u);
    for (size_t m = 1, lobe = 0; m <= given; ++m) {
        double sum = 0;
        sums.clear();
        for (size_t end = lobe + static_cast<size_t>(medium_column(kMediumLobes, m));
             lobe + sums.size() < end;)
            sums.push_back(sum += all[lobe + sums.size()].share);
        put_intervals(sums, phase_ends.data() + lobe, guides.data() + 2 * m, 0);
        lobe += sums.size();
    }
    size_t at = 0;
    for (size_t k = 0; k < all.size(); ++k) {
        const Lobe& lobe = all[k];
        const auto put = [&](uint32_t c, float x) { lobes[size_t{c} * phases.stride + k] = x; };
        put(kLobeKind, static_cast<float>(lobe.kind));
        put(kLobeShare, static_cast<float>(lobe.share));
        put(kLobeG, static_cast<float>(lobe.g));
        if (lobe.kind == kFlakes)
            put_flakes(in.lobe_flakes.data + 6 * size_t{lobe.row},
                       lobes.data() + size_t{kLobeFlakes} * phases.stride + k, phases.stride);
        if (lobe.kind != kTabulated) continue;
        const uint32_t cells = in.lobe_size.data[lobe.row] - 1;
        put(kLobeCells, static_cast<float>(cells));
        put(kLobeFirst, bit_cast<float>(static_cast<uint32_t>(at)));
        put(kLobeGuide, bit_cast<float>(static_cast<uint32_t>(guides.size())));
        const float* given_values = in.phase_values.data + in.lobe_values.data[lobe.row];
        double sum = 0;
        sums.clear();
        for (uint32_t i = 0; i < cells; ++i)
            sums.push_back(sum += static_cast<double>(given_values[i]) +
                                  static_cast<double>(given_values[i + 1]));
        guides.resize(guides.size() + guide);
        put_intervals(sums, phase_ends.data() + all.size() + at,
                      guides.data() + guides.size() - guide, phases.bits);
        // A piece is 2 / cells wide, and its mean half the sum of its ends.
        const double scale = cells / (2 * kPiDouble * sum);
        for (uint32_t i = 0; i <= cells; ++i)
            phase_values[at + i] = static_cast<float>(static_cast<double>(given_values[i]) * scale);
        double before = 0, start = 0;
        for (uint32_t i = 0; i < cells; ++i) {
            const double end = static_cast<double>(phase_ends[all.size() + at + i]);
            const double share = (sums[i] - before) / sum;
            phase_drawn[at + i] =
                share > 0 ? static_cast<float>((end - start) * 0x1p-24 / share) : 1.f;
            before = sums[i], start = end;
        }
        at += cells + 1;
    }
    phase_guides.assign(guides.begin(), guides.end());
    phases.lobes = lobes.data(), phases.values = phase_values.data();
    phases.drawn = phase_drawn.data(), phases.ends = phase_ends.data();
    phases.guides = phase_guides.data();
}

}  // namespace veriray
