// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/metrics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace stgs::encoder {
namespace {

constexpr int kWindow = 11;
constexpr double kWindowSigma = 1.5;
constexpr double kK1 = 0.01, kK2 = 0.03;
constexpr std::size_t kMoments = 5;  // a, b, aa, bb, ab

std::array<float, kWindow> window() {
  std::array<double, kWindow> w{};
  double sum = 0;
  constexpr int kCentre = kWindow / 2;
  for (int i = 0; i < kWindow; ++i) {
    const double x = i - kCentre;
    w[i] = std::exp(-x * x / (2 * kWindowSigma * kWindowSigma));
    sum += w[i];
  }
  std::array<float, kWindow> out{};
  for (int i = 0; i < kWindow; ++i) out[i] = static_cast<float>(w[i] / sum);
  return out;
}

// Filters one row of the five moments along x, at valid positions only.
void filter_row(const float* a, const float* b, int valid, const std::array<float, kWindow>& w,
                std::array<std::vector<float>, kMoments>& out) {
  for (auto& row : out) std::fill(row.begin(), row.end(), 0.0f);
  for (int k = 0; k < kWindow; ++k) {
    for (int x = 0; x < valid; ++x) {
      const float va = a[x + k], vb = b[x + k];
      out[0][x] += w[k] * va;
      out[1][x] += w[k] * vb;
      out[2][x] += w[k] * va * va;
      out[3][x] += w[k] * vb * vb;
      out[4][x] += w[k] * va * vb;
    }
  }
}

double similarity(const std::array<float, kMoments>& m, double range) {
  const double c1 = (kK1 * range) * (kK1 * range), c2 = (kK2 * range) * (kK2 * range);
  const double ma = m[0], mb = m[1];
  const double va = m[2] - ma * ma, vb = m[3] - mb * mb, cov = m[4] - ma * mb;
  return ((2 * ma * mb + c1) * (2 * cov + c2)) / ((ma * ma + mb * mb + c1) * (va + vb + c2));
}

// Returns the sums of the similarity over the valid positions of one channel.
Ssim channel_sums(const float* a, const float* b, int width, int height) {
  const auto w = window();
  const int valid = width - kWindow + 1;
  // Ring buffer of the last kWindow filtered rows: row y is in slot y % kWindow.
  std::array<std::array<std::vector<float>, kMoments>, kWindow> rows;
  for (auto& slot : rows) {
    for (auto& row : slot) row.resize(static_cast<std::size_t>(valid));
  }
  Ssim sums;
  for (int y = 0; y < height; ++y) {
    const std::ptrdiff_t offset = static_cast<std::ptrdiff_t>(y) * width;
    filter_row(a + offset, b + offset, valid, w, rows[y % kWindow]);
    if (y + 1 < kWindow) continue;
    for (int x = 0; x < valid; ++x) {
      std::array<float, kMoments> m{};
      for (int k = 0; k < kWindow; ++k) {
        const auto& slot = rows[(y + 1 + k) % kWindow];
        for (std::size_t i = 0; i < kMoments; ++i) m[i] += w[k] * slot[i][x];
      }
      sums.range_1 += similarity(m, 1);
      sums.range_2 += similarity(m, 2);
    }
  }
  return sums;
}

// Solves a x = b, where a is positive semidefinite and the system has a solution, and writes x to
// b. Gauss-Jordan elimination with the largest diagonal element as pivot; unknowns without a pivot
// are 0.
void solve_semidefinite(double (&a)[4][4], double (&b)[4][3]) {
  const double largest = std::max({a[0][0], a[1][1], a[2][2], a[3][3]});
  const double negligible = 1e-14 * largest;  // 4 x 4 products, rounded to 1.1e-16 each
  bool done[4] = {};
  for (int step = 0; step < 4; ++step) {
    int p = -1;
    for (int i = 0; i < 4; ++i) {
      if (!done[i] && (p < 0 || a[i][i] > a[p][p])) p = i;
    }
    if (a[p][p] <= negligible) break;
    done[p] = true;
    for (int r = 0; r < 4; ++r) {
      if (r == p) continue;
      const double factor = a[r][p] / a[p][p];
      for (int c = 0; c < 4; ++c) a[r][c] -= factor * a[p][c];
      for (int c = 0; c < 3; ++c) b[r][c] -= factor * b[p][c];
    }
  }
  for (int i = 0; i < 4; ++i) {
    for (int c = 0; c < 3; ++c) b[i][c] = done[i] ? b[i][c] / a[i][i] : 0;
  }
}

}  // namespace

Image to_float(const Image8& image) {
  Image out;
  out.reshape(image.width, image.height, 3);
  const std::size_t pixels = static_cast<std::size_t>(image.width) * image.height;
  for (int c = 0; c < 3; ++c) {
    float* plane = out.plane(c);
    for (std::size_t i = 0; i < pixels; ++i) {
      plane[i] = static_cast<float>(image.data[i * 3 + c]) / 255.0f;
    }
  }
  return out;
}

Status check_finite(const Image& image, const std::string& name) {
  const auto bad =
      std::find_if(image.data.begin(), image.data.end(), [](float v) { return !std::isfinite(v); });
  if (bad == image.data.end()) return {};
  const std::ptrdiff_t at = bad - image.data.begin();
  const std::ptrdiff_t pixels = static_cast<std::ptrdiff_t>(image.width) * image.height;
  return invalid_file("{}: channel {} of pixel ({}, {}) is {} (expected a finite value)", name,
                      "RGB"[at / pixels], at % pixels % image.width, at % pixels / image.width,
                      *bad);
}

double mean_squared_error(const Image& a, const Image& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.data.size(); ++i) {
    const double d = static_cast<double>(a.data[i]) - b.data[i];
    sum += d * d;
  }
  return sum / static_cast<double>(a.data.size());
}

double psnr_of(double mse) {
  if (mse <= 0) return kPsnrMax;
  const double psnr = -10 * std::log10(mse);
  return psnr > kPsnrMax ? kPsnrMax : psnr;  // this order propagates NaN
}

double max_difference(const Image& a, const Image& b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.data.size(); ++i) {
    largest = std::max(largest, std::abs(static_cast<double>(a.data[i]) - b.data[i]));
  }
  return largest;
}

double colour_corrected_error(const Image& image, const Image& ground_truth) {
  const std::size_t pixels = static_cast<std::size_t>(image.width) * image.height;
  const float* in[] = {image.plane(0), image.plane(1), image.plane(2)};
  const float* out[] = {ground_truth.plane(0), ground_truth.plane(1), ground_truth.plane(2)};
  double normal[4][4] = {}, right[4][3] = {};
  for (std::size_t i = 0; i < pixels; ++i) {
    const double x[4] = {in[0][i], in[1][i], in[2][i], 1};
    for (int r = 0; r < 4; ++r) {
      for (int c = 0; c < 4; ++c) normal[r][c] += x[r] * x[c];
      for (int c = 0; c < 3; ++c) right[r][c] += x[r] * out[c][i];
    }
  }
  // The normal matrix is singular for an image of few colours. Any minimiser is then correct.
  solve_semidefinite(normal, right);
  double sum = 0;
  for (std::size_t i = 0; i < pixels; ++i) {
    for (int c = 0; c < 3; ++c) {
      const double mapped =
          in[0][i] * right[0][c] + in[1][i] * right[1][c] + in[2][i] * right[2][c] + right[3][c];
      sum += (mapped - out[c][i]) * (mapped - out[c][i]);
    }
  }
  return sum / static_cast<double>(3 * pixels);
}

std::uint64_t ssim_bytes(int width) {
  return sizeof(float) * kWindow * kMoments * static_cast<std::uint64_t>(std::max(width, 0));
}

Result<Ssim> ssim(const Image& a, const Image& b) {
  if (a.width < kWindow || a.height < kWindow) {
    return unsupported("SSIM needs images of at least {0}x{0} pixels (got {1}x{2})", kWindow,
                       a.width, a.height);
  }
  Ssim mean;
  for (int c = 0; c < 3; ++c) {
    const Ssim sums = channel_sums(a.plane(c), b.plane(c), a.width, a.height);
    mean.range_1 += sums.range_1;
    mean.range_2 += sums.range_2;
  }
  const double positions = 3.0 * (a.width - kWindow + 1.0) * (a.height - kWindow + 1.0);
  mean.range_1 /= positions;
  mean.range_2 /= positions;
  return mean;
}

}  // namespace stgs::encoder
