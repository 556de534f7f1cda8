// Tables of what rough mirrors lose (bsdfs/lost_light.h).
#pragma once

#include <vector>

namespace veriray {

// What is lost at kLostCells + 1 cosines, and of diffuse light: the mean of the former as closures
// interpolate it. eta: index beyond over index here of an interface; 0: of mirrors that reflect
// all. By quadrature in float64; see docs/limits.md for how exact.
struct LostLightTable {
    std::vector<float> at_cosine;
    double mean;
};
LostLightTable lost_light(double alpha, bool ggx, bool correlated, double eta);

// Reflectance for diffuse light of a conductor, and of an interface.
double mean_reflectance(double eta, double k);
double mean_reflectance(double eta);

}  // namespace veriray
