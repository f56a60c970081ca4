//! The camera: fixed in the world, or in orbit around the fitted hair.

use std::ops::Range;

use anyhow::{Result, bail};
use glam::{DMat3, DQuat, DVec3, Vec3};

/// Share of the frame that the fitted hair takes, of the height or width, whichever binds.
const FILL: f64 = 0.85;

/// Where the camera is, as a user states it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraSpec {
    pub view: View,
    /// World point looked at; `None` is the centre of the hair.
    pub target: Option<[f64; 3]>,
    /// Vertical field of view, degrees.
    pub fov_deg: f64,
}

/// The two ways to place a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum View {
    /// At a world point.
    Position([f64; 3]),
    Orbit(Orbit),
}

/// Angles around the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// Degrees from +z (before the face) towards +x.
    pub azimuth_deg: f64,
    /// Degrees above the horizon.
    pub elevation_deg: f64,
    /// In radii of the fitted hair; `None` frames it.
    pub distance: Option<f64>,
}

/// A camera in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    pub position: DVec3,
    pub target: DVec3,
    /// Unit vector at a right angle to the view.
    pub up: DVec3,
    /// Vertical field of view, degrees.
    pub fov_deg: f64,
}

/// A camera as rays see it: the point (x, y) of the image, both in [−1, 1] with y up, looks along
/// forward + x·right + y·up. Of a camera's whole image these are at right angles and forward a unit vector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Relative to a chosen centre, as the geometry is that it looks at.
    pub eye: DVec3,
    pub forward: DVec3,
    /// Half the image's width at unit distance.
    pub right: DVec3,
    /// Half the image's height at unit distance.
    pub up: DVec3,
    /// From the eye to what the camera looks at.
    pub distance: f64,
    /// Width and height of the image in pixels.
    pub size: [u32; 2],
}

impl Default for CameraSpec {
    fn default() -> Self {
        Self { view: View::Orbit(Orbit::default()), target: None, fov_deg: 30.0 }
    }
}

impl Default for Orbit {
    /// A three-quarter view from a little above.
    fn default() -> Self {
        Self { azimuth_deg: 25.0, elevation_deg: 5.0, distance: None }
    }
}

impl CameraSpec {
    /// The camera for hair within `radius` of `center`, for a frame of width / height `aspect`.
    ///
    /// # Errors
    /// One line, if position and target coincide.
    pub fn resolve(&self, center: Vec3, radius: f32, aspect: f64) -> Result<Camera> {
        let target = self.target.map_or(center.as_dvec3(), DVec3::from_array);
        let position = match self.view {
            View::Position(position) => DVec3::from_array(position),
            View::Orbit(Orbit { azimuth_deg, elevation_deg, distance }) => {
                let (sin_azimuth, cos_azimuth) = azimuth_deg.to_radians().sin_cos();
                let (sin_elevation, cos_elevation) = elevation_deg.to_radians().sin_cos();
                let outward = DVec3::new(
                    sin_azimuth * cos_elevation,
                    sin_elevation,
                    cos_azimuth * cos_elevation,
                );
                let radii = distance.unwrap_or_else(|| framing_distance(self.fov_deg, aspect));
                target + outward * radii * f64::from(radius)
            }
        };
        let Some(forward) = (target - position).try_normalize() else {
            bail!("the camera stands at its own target; move camera.position or camera.target");
        };
        // Seen from right above or below there is no upright; the face (+z) then points down.
        let upright = if forward.y.abs() < 1.0 - 1e-9 {
            DVec3::Y
        } else {
            DVec3::NEG_Z * -forward.y.signum()
        };
        let up = upright.reject_from_normalized(forward).normalize();
        Ok(Camera { position, target, up, fov_deg: self.fov_deg })
    }
}

/// Distance, in radii, at which a sphere fills [`FILL`] of the tighter side of the frame: its
/// outline has tan = 1/√(d² − 1).
fn framing_distance(fov_deg: f64, aspect: f64) -> f64 {
    let tan_half_fov = (fov_deg / 2.0).to_radians().tan() * aspect.min(1.0);
    (1.0 + (FILL * tan_half_fov).powi(-2)).sqrt()
}

impl Camera {
    /// This camera for an image of `size`, with `center` as the origin.
    pub fn lens(&self, center: Vec3, size: [u32; 2]) -> Lens {
        let to_target = self.target - self.position;
        let distance = to_target.length();
        let forward = to_target / distance;
        let half_height = (self.fov_deg / 2.0).to_radians().tan();
        let half_width = half_height * f64::from(size[0]) / f64::from(size[1]);
        Lens {
            eye: self.position - center.as_dvec3(),
            forward,
            right: half_width * forward.cross(self.up),
            up: half_height * self.up,
            distance,
            size,
        }
    }

    /// This camera after it has gone `angle_deg` further around the vertical through its target,
    /// towards greater azimuth.
    pub fn turned(&self, angle_deg: f64) -> Camera {
        let turn = DQuat::from_rotation_y(angle_deg.to_radians());
        Camera {
            position: self.target + turn * (self.position - self.target),
            up: turn * self.up,
            ..*self
        }
    }
}

/// The size in pixels of the largest frame of the shape `output` (width × height) that fits into a view of the size
/// `view`, its middle in the middle and its borders between pixels of the view.
pub fn frame_within(output: [u32; 2], view: [u32; 2]) -> [u32; 2] {
    let [width, height] = [0, 1].map(|k| f64::from(view[k]) / f64::from(output[k].max(1)));
    let scale = width.min(height);
    [0, 1].map(|k| {
        let side = ((scale * f64::from(output[k])).round() as u32).clamp(1, view[k].max(1));
        // An even number of pixels is left, half of them on each side.
        if (view[k] - side) % 2 == 1 { side + 1 } else { side }
    })
}

impl Lens {
    /// Some rows of the image, from the top, as an image of their own.
    pub fn rows(&self, rows: Range<u32>) -> Lens {
        let [width, height] = self.size;
        let [first, end] = [rows.start, rows.end].map(f64::from);
        let middle = 1.0 - (first + end) / f64::from(height);
        let count = rows.end - rows.start;
        Lens {
            forward: self.forward + middle * self.up,
            up: self.up * (f64::from(count) / f64::from(height)),
            size: [width, count],
            ..*self
        }
    }

    /// Vectors whose products with a place relative to the eye are x·w, y·w and w, where (x, y) is the point of the
    /// image that sees it and w its depth. Inverse of [`Self::direction`].
    pub fn image_axes(&self) -> [DVec3; 3] {
        let inverse = DMat3::from_cols(self.right, self.up, self.forward).inverse().transpose();
        [inverse.x_axis, inverse.y_axis, inverse.z_axis]
    }

    /// The same camera for an image of `size` in pixels, each as large as it is now, around the middle of this one.
    pub fn around(&self, size: [u32; 2]) -> Lens {
        let [wider, higher] = [0, 1].map(|k| f64::from(size[k]) / f64::from(self.size[k]));
        Lens { right: wider * self.right, up: higher * self.up, size, ..*self }
    }

    /// Pixels that a unit length at unit distance spans.
    pub fn pixels_per_unit(&self) -> f64 {
        0.5 * f64::from(self.size[1]) / self.up.length()
    }

    /// Direction, not of unit length, through a place in the image in pixels, y down.
    pub fn direction(&self, x: f64, y: f64) -> DVec3 {
        let [width, height] = self.size.map(f64::from);
        self.forward + (2.0 * x / width - 1.0) * self.right + (1.0 - 2.0 * y / height) * self.up
    }
}
