#version 330
uniform mat4 clip_from_world;
in vec2 in_place;
out vec3 position;

void main() {
    position = vec3(in_place, 0.0);
    gl_Position = clip_from_world * vec4(position, 1.0);
}
