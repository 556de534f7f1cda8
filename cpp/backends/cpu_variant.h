// What the CPU back end calls of a compiled variant. Each is a translation unit of its own
// (cpu_variant.cpp), so that they compile side by side.
#pragma once

#include <vector>

#include "backends/instances.h"
#include "schedulers/thrust_bodies.h"
#include "schedulers/tile.h"
#include "schedulers/wavefront.h"

namespace veriray {

struct CpuVariant {
    ColumnCount path, request;
    // Tile::run.
    void (*tile)(Tile& tile, const SceneView& scene, const Job& job, uint32_t pixel,
                 uint32_t pixels, uint32_t sample, uint32_t samples, LedgerRows& ledger);
    // thrust_begin and thrust_bounce of the places [begin, end).
    void (*thrust_begin)(const SceneView& scene, const Job& job, const Columns& paths,
                         int32_t* indices, uint64_t first, uint32_t begin, uint32_t end);
    void (*thrust_bounce)(const SceneView& scene, const Job& job, const PathPool& pool,
                          const PathIndices& indices, uint32_t depth, uint32_t begin, uint32_t end,
                          uint64_t* ledger_row);
    // run_wave_tile.
    void (*wave_tile)(const SceneView& scene, const Job& job, const Wave& wave, uint32_t tile,
                      LedgerRows& ledger);
    // Vertices of a path; of the last variant alone.
    void (*trace)(const HostScene& host, const PathSettings& settings, uint32_t x, uint32_t y,
                  uint32_t sample, std::vector<PathVertex>& out);
};

template <uint32_t kIndex>
const CpuVariant& cpu_variant_at(uint32_t integrator);

template <uint32_t kIndex = 0>
const CpuVariant& cpu_variant(uint32_t integrator, uint32_t index) {
    if constexpr (kIndex + 1 < kVariantCount)
        if (index != kIndex) return cpu_variant<kIndex + 1>(integrator, index);
    return cpu_variant_at<kIndex>(integrator);
}

inline const CpuVariant& chosen_variant(const SceneView& scene, const RenderSettings& s) {
    return cpu_variant(kIntegrator, choose_variant(scene, s));
}

}  // namespace veriray
