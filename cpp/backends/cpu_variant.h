// What the CPU back end calls of the compiled variants. Each is a translation unit of its own for
// `fused` (cpu_variant.cpp), so that they compile side by side.
#pragma once

#include <vector>

#include "backends/instances.h"
#include "scene/variants.h"
#include "schedulers/thrust_bodies.h"
#include "schedulers/tile.h"
#include "schedulers/wavefront.h"

namespace veriray {

struct CpuVariant {
    ColumnCount path;
    // Tile::run.
    void (*tile)(Tile& tile, const SceneView& scene, const Job& job, uint32_t pixel,
                 uint32_t pixels, uint32_t sample, uint32_t samples, LedgerRows& ledger);
};

// Of the schedulers that are not the default one; kFewVariants.
struct CpuWaves {
    ColumnCount path, request;
    // thrust_begin and thrust_bounce of the places [begin, end).
    void (*thrust_begin)(const SceneView& scene, const Job& job, const Columns& paths,
                         int32_t* indices, uint64_t first, uint32_t begin, uint32_t end);
    void (*thrust_bounce)(const SceneView& scene, const Job& job, const PathPool& pool,
                          const PathIndices& indices, uint32_t depth, uint32_t begin, uint32_t end,
                          uint64_t* ledger_row);
    // run_wave_tile.
    void (*wave_tile)(const SceneView& scene, const Job& job, const Wave& wave, uint32_t tile,
                      LedgerRows& ledger);
    // Vertices of a path.
    void (*trace)(const HostScene& host, const PathSettings& settings, uint32_t x, uint32_t y,
                  uint32_t sample, std::vector<PathVertex>& out);
};
const CpuWaves& cpu_waves(uint32_t integrator, uint32_t index);

template <uint32_t kIndex>
const CpuVariant& cpu_variant_at(uint32_t integrator);

template <uint32_t kIndex = 0>
const CpuVariant& cpu_variant(uint32_t integrator, uint32_t index) {
    if constexpr (kIndex + 1 < kVariantCount)
        if (index != kIndex) return cpu_variant<kIndex + 1>(integrator, index);
    return cpu_variant_at<kIndex>(integrator);
}

}  // namespace veriray
