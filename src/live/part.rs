//! Parts of a scene that may turn out to be unusable, each of which is replaced alone.

use std::path::Path;

use crate::scene::{EnvironmentSpec, HairSpec, Scene};

/// A part of a scene that comes from outside or can contradict the rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScenePart {
    /// The groom, without what is painted on it.
    Hair,
    /// The file of what is painted on the hair.
    Paint,
    Head,
    /// The environment's file, whatever its rotation, exposure and number of lights.
    Map,
    Camera,
    Quality,
    Adapter,
}

/// Why a picture cannot be made: a part of the scene asked for, and what can be used in its place.
#[derive(Clone, Debug)]
pub struct Refusal {
    pub part: ScenePart,
    /// The reason, in one line.
    pub line: String,
    /// The scene that was asked for.
    pub refused: Scene,
    /// A scene whose `part` can be used: the last one that was, or else the default.
    pub instead: Scene,
}

impl ScenePart {
    /// Copies this part of `from` into `to`.
    pub fn copy(self, from: &Scene, to: &mut Scene) {
        match self {
            Self::Hair => {
                let paint = to.hair.paint.take();
                to.hair = HairSpec { paint, ..from.hair.clone() };
            }
            Self::Paint => to.hair.paint.clone_from(&from.hair.paint),
            Self::Head => to.head.clone_from(&from.head),
            Self::Map => {
                let EnvironmentSpec { rotation_deg, exposure, lights, .. } = to.environment;
                to.environment =
                    EnvironmentSpec { rotation_deg, exposure, lights, ..from.environment.clone() };
            }
            Self::Camera => to.camera = from.camera,
            Self::Quality => to.render.quality = from.render.quality,
            Self::Adapter => to.render.adapter.clone_from(&from.render.adapter),
        }
    }

    /// Whether two scenes have the same part.
    pub fn same(self, a: &Scene, b: &Scene) -> bool {
        let mut other = a.clone();
        self.copy(b, &mut other);
        other == *a
    }

    /// What a user calls this part of a scene: a file by its name alone.
    pub fn describe(self, scene: &Scene) -> String {
        match self {
            Self::Hair => file_name(&scene.hair.source),
            Self::Paint => scene.hair.paint.as_deref().map_or("no paint".to_owned(), file_name),
            Self::Head if scene.head.source == "none" => "no head".to_owned(),
            Self::Head if scene.head.source == "auto" => "the head of the hair".to_owned(),
            Self::Head => file_name(&scene.head.source),
            Self::Map => file_name(&scene.environment.source),
            Self::Camera => "the camera before".to_owned(),
            Self::Quality => "the quality before".to_owned(),
            Self::Adapter => format!("the adapter `{}`", scene.render.adapter),
        }
    }
}

/// The last part of a path; a builtin's name and a word as they are.
pub fn file_name(source: &str) -> String {
    let name = Path::new(source).file_name();
    name.map_or(source.to_owned(), |name| name.to_string_lossy().into_owned())
}
