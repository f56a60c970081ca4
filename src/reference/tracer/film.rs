//! What a render has gathered, pixel by pixel; more samples may always be added.

use bytemuck::{Pod, Zeroable};

/// Sums over the samples of one pixel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Pixel {
    /// Radiance, linear RGB, 0 where a sample met nothing.
    pub sum: [f64; 3],
    pub squares: [f64; 3],
    /// Samples that met a strand or the head.
    pub covered: u32,
    /// Samples that met a strand.
    pub hair: u32,
}

/// Sums of all pixels, each over the same number of samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    /// Width and height.
    pub size: [u32; 2],
    /// Samples that every pixel has.
    pub samples: u32,
    /// Rays traced for them: path segments and shadow rays.
    pub segments: u64,
    /// Row-major from the top; length: width · height.
    pub pixels: Vec<Pixel>,
}

impl Film {
    pub fn new(size: [u32; 2]) -> Film {
        let pixels = vec![Pixel::default(); size[0] as usize * size[1] as usize];
        Film { size, samples: 0, segments: 0, pixels }
    }

    /// Mean radiance premultiplied by alpha, linear RGB, and alpha of pixel `i`; 0 before the first sample.
    pub fn mean(&self, i: usize) -> [f64; 4] {
        let pixel = &self.pixels[i];
        let [r, g, b] = pixel.sum.map(|sum| self.share(sum));
        [r, g, b, self.share(pixel.covered.into())]
    }

    /// Share of pixel `i` that hair covers, in [0, 1].
    pub fn hair_coverage(&self, i: usize) -> f64 {
        self.share(self.pixels[i].hair.into())
    }

    /// Variance of [`Self::mean`]'s RGB, as it were for independent samples: Owen-scrambled ones do no worse.
    /// Infinite before the second sample.
    pub fn variance(&self, i: usize) -> [f64; 3] {
        if self.samples < 2 {
            return [f64::INFINITY; 3];
        }
        let pixel = &self.pixels[i];
        let n = f64::from(self.samples);
        std::array::from_fn(|c| {
            let mean = pixel.sum[c] / n;
            (pixel.squares[c] / n - mean * mean).max(0.0) / (n - 1.0)
        })
    }

    fn share(&self, sum: f64) -> f64 {
        sum / f64::from(self.samples.max(1))
    }
}

impl Pixel {
    pub(super) fn add(&mut self, radiance: [f64; 3], covered: bool, hair: bool) {
        for (c, value) in radiance.into_iter().enumerate() {
            self.sum[c] += value;
            self.squares[c] += value * value;
        }
        self.covered += u32::from(covered);
        self.hair += u32::from(hair);
    }
}
