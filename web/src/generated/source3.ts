// Written by `cargo xtask web`; changes are lost.

export const text = "fn T9t(Tc:u32,T3:vec2<f32>,T0:u32)->vec4<f32>{let T4u=(Tc==1u)&(T2.Tdb==1u);let T4=Tb(select(T2.Tj1,T2.Tj2,T4u),T0);let at=T3*(1.0/f32(i32(1u<<T0)))-vec2<f32>(0.5);let Tt=floor(at);let Tr=T21(vec2<i32>(Tt),T4);let T1l=T4p(Tr,T21(vec2<i32>(Tt)+vec2<i32>(1),T4),at-Tt);var a=vec4<f32>(0.0);if!T4u{a=T3s(T83,T1l,T0);}var b=a;if T4u|(T2.T4a==T4c){b=T3s(Tcy,T1l,T0);}return T2b(select(a,b,T4u),b,T2.T4a);}\n";
