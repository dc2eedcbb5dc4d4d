// Written by `cargo xtask web`; changes are lost.

export const text = "fn Taw(Te:u32,T2:vec2<f32>,T0:u32)->vec4<f32>{let T3r=(Te==1u)&(T3.Ten==1u);let T6=Td(select(T3.Tkq,T3.Tkr,T3r),T0);let at=T2*(1.0/f32(i32(1u<<T0)))-vec2<f32>(0.5);let Ts=floor(at);let Ty=T2d(vec2<i32>(Ts),T6);let T1r=T5g(Ty,T2d(vec2<i32>(Ts)+vec2<i32>(1),T6),at-Ts);var a=vec4<f32>(0.0);if!T3r{a=T44(T98,T1r,T0);}var b=a;if T3r|(T3.T4v==T4x){b=T44(Te8,T1r,T0);}return T2o(select(a,b,T3r),b,T3.T4v);}\n";
